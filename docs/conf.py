"""The documentation as a static site; `make docs` builds it, and any dead link fails the build."""

from __future__ import annotations

from importlib import metadata

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

project = "deltact-fab"
author = "the deltact-fab authors"
release = metadata.version("deltact-fab")

extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["evidence/studies"]
nitpicky = True
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
