"""The documentation as a static site; `make docs` builds it, and any dead link fails the build."""

from __future__ import annotations

from importlib import metadata

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

project = "deltact-fab"
author = "the deltact-fab authors"
release = metadata.version("deltact-fab")

extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["evidence/studies"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other packages, and of ours that have no page
default_role = "code"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"deltact-fab {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False


def setup(app: Sphinx) -> None:
    """CSV has no lexer of its own."""
    app.add_lexer("csv", TextLexer)
