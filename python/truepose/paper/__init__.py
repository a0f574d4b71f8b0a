"""The source paper: its tables, its robots and experiments, and what truepose reproduces of it."""

from truepose.paper.article import with_paper_errors

__all__ = ["with_paper_errors"]
