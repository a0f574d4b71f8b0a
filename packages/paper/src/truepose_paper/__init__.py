"""The source paper: tables, robots and experiments, and their reproduction."""

from truepose_paper.article import with_paper_errors

__all__ = ["with_paper_errors"]
