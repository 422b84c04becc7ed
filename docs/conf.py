"""Settings of Sphinx, for `make docs`: the pages of this folder, and the interface from its docstrings."""

from unc_physics import __version__

project = "unc_physics"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_theme_options = {"page_width": "1100px"}

autodoc_mock_imports = [  # of the node's client; documents are made without ROS, too
    "action_msgs",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "rclpy",
    "shape_msgs",
    "unc_physics_msgs",
]
autodoc_typehints = "none"  # the docstrings say more: shapes, units, frames
autodoc_member_order = "bysource"
default_role = "literal"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]  # pages link to files outside this folder, as GitHub shows them
