"""Settings of Sphinx. `make.py` stages the pages and calls it."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

SITE = Path(__file__).parent
sys.path.insert(0, str(SITE))

project = "truepose"
author = "the truepose authors"
project_copyright = "the truepose authors; MIT licence"
version = release = version_of("truepose")

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "breathe", "equations"]
highlight_language = "none"  # a block without a language is an equation, or for a shell
toc_object_entries = False  # breathe adds them all the same: see setup

myst_enable_extensions = ["attrs_block", "dollarmath"]
myst_heading_anchors = 4

autodoc_typehints = "none"  # numpydoc's sections name the types
autodoc_member_order = "groupwise"
numpydoc_show_class_members = False

breathe_projects = {"truepose": ""}  # make.py says where
breathe_default_project = "truepose"

html_theme = "furo"
html_title = "truepose"
html_math_renderer = "drawn"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False


def setup(app) -> None:
    """Keep every member of every C++ struct out of every page's table of contents."""
    app.connect("doctree-read", _without_members, priority=400)  # the collector of titles: 500


def _without_members(_app, doctree) -> None:
    from sphinx.addnodes import desc_signature

    for signature in doctree.findall(desc_signature):
        signature["_toc_name"] = ""
