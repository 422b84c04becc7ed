"""Settings of Sphinx, for `make docs`: the pages of this folder, and the interface from its docstrings."""

from unc_physics import __version__

project = "unc_physics"
release = version = __version__
copyright = "unc_physics maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"unc_physics {__version__}"
html_static_path = ["static"]
html_css_files = ["wide.css"]

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
numpydoc_show_class_members = False  # autodoc lists them
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
