"""Settings of the documentation: `make docs` builds it, with no network and with warnings as errors."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import roslf_design

project = "roslf_design"
author = "the roslf_design authors"
project_copyright = author
version = release = roslf_design.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "docstrings", "generated", "notebooks", "pictures"]
exclude_patterns = ["_build", "_generated", "_ext", "**/.ipynb_checkpoints"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
default_role = "py:obj"
suppress_warnings = ["myst.header"]  # generated parts start at the level that fits where they are included

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_type_aliases = {name: name for name in ("ArrayLike", "Array", "Floats")}
python_display_short_literal_types = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90

html_theme = "furo"
html_title = "roslf_design"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": False}
pygments_style = "friendly"
pygments_dark_style = "github-dark"
