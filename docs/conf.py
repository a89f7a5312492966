"""Sphinx's settings. The source folder is the repository: `sphinx-build -c docs . out/docs`."""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

import boat_daq  # noqa: E402 - found through the path above

project = "boat-daq"
author = "the boat-daq developers"
copyright = "2026, the boat-daq developers"
release = version = boat_daq.__version__

root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "analysis/**METHODS.md",
    "protocol/SPEC.md",
    "protocol/firmware/README.md",
]
exclude_patterns = [".*", "out", "build", "tests", "boat_daq", "**/__pycache__"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "command_reference",
    "compact_docstrings",
    "described_values",
    "public_names",
]
default_role = "code"  # docstrings put names between single backticks, as Markdown does
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

autodoc_typehints = "signature"
autodoc_type_aliases = {alias: alias for alias in ("FloatArray", "IntArray", "BoolArray", "npt.ArrayLike")}
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
toc_object_entries = False

html_theme = "furo"
html_title = "boat-daq"
html_static_path = ["_static"]
html_css_files = ["site.css"]
templates_path = ["_templates"]
html_additional_pages = {"index": "redirect.html"}
html_copy_source = False
html_show_sphinx = False
