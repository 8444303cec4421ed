"""How Sphinx makes the site of these pages: ``python -m sphinx -W -b html docs build/site``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import rig

project = "rig"
author = "the authors of rig"
copyright = author
release = version = rig.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "beyond", "reference"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_ext", "figures"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "html_image"]
highlight_language = "none"  # a block says what it is, or is plain text

toc_object_entries = False  # functions and classes are found by search, and by the index
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
napoleon_google_docstring = False

suppress_warnings = ["ref.python"]  # drivers and rig each have a RefusedError, which docstrings call so

html_theme = "furo"
html_title = "rig"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
