"""Settings of Sphinx, for `make docs`."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

from generate_reference import ROS_MODULES
from notebooks import TUTORIALS, write_notebooks

from unc_physics import __version__

write_notebooks(TUTORIALS)  # which the tutorials offer for download

project = "unc_physics"
release = version = __version__
copyright = "unc_physics maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "generate_reference"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"unc_physics {__version__}"
html_static_path = ["static"]
html_css_files = ["wide.css"]

autodoc_mock_imports = ROS_MODULES
autodoc_typehints = "none"  # the docstrings say more: shapes, units, frames
autodoc_member_order = "bysource"
default_role = "literal"
numpydoc_show_class_members = False  # autodoc lists them
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
