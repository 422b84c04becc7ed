"""Build of the package for colcon and for pip; the interfaces are a package of their own, in
unc_physics_msgs/.
"""

from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup

NAME = "unc_physics"
HERE = Path(__file__).resolve().parent
README = HERE / "README.md"


def shared(folder, *patterns):
    """The files of a folder that go to the same folder under share/unc_physics; nothing when
    there are none.
    """
    files = sorted(file for pattern in patterns for file in glob(f"{folder}/{pattern}", root_dir=HERE))
    return [(f"share/{NAME}/{folder}", files)] if files else []


class MaybeCompiled(Distribution):
    """A distribution whose wheel is for one Python and platform if it holds compiled kernels."""

    def has_ext_modules(self):
        return any((HERE / NAME / "kernels").glob("*/*.kernel"))

    def has_data(self):
        """Have an editable install copy `data_files`, which ros2 run and ros2 launch look for.

        setuptools copies them in other installs, where it asks `has_data_files`.
        """
        return self.has_data_files()


# coacd for decompositions, manifold3d for the mug's handle, networkx for repairs, matplotlib for pictures
GEOMETRY = ["coacd>=1.0.14", "manifold3d>=3", "matplotlib>=3.7", "networkx>=3", "scipy", "trimesh>=4"]
# yourdfpy for robots and worlds in URDF
DESCRIPTIONS = [*GEOMETRY, "yourdfpy>=0.0.56"]
# mujoco compiles MJCF
MJCF = [*DESCRIPTIONS, "mujoco>=3.2"]
# pyarrow for stores of answers, distributed for clusters of Dask
MANY = ["distributed>=2024.1", "pyarrow>=14"]
# viser for the page in the browser
VIEW = ["viser>=1.1"]

setup(
    name=NAME,
    version="0.3.0.dev0",
    description="Predicts where rigid objects will be, and how certain that is, through contact",
    long_description=README.read_text(encoding="utf-8") if README.is_file() else "",
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="unc_physics maintainers",
    maintainer_email="maintainers@unc-physics.invalid",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["__init__.pyi", "py.typed", "schemas/*.schema.json", "kernels/*/*.kernel"]},
    distclass=MaybeCompiled,
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # ros2 run looks here. Scripts of setuptools would not do: they name the Python that built them, which
        # under colcon is the system's, not that of the active venv.
        (f"lib/{NAME}", sorted(glob("scripts/*", root_dir=HERE))),
        *shared("models", "*.npz", "README.md"),
        *shared("examples", "*.py"),
        *shared("examples/scenes", "*.yaml"),
        *shared("examples/tosses", "*"),
        *shared("launch", "*.py"),
        *shared("config", "*.yaml", "*.rviz", "*.xml"),
    ],
    install_requires=["numba>=0.60,<0.69", "numpy>=1.26", "pyyaml>=6", "tqdm>=4.60"],
    extras_require={
        "association": ["scipy"],
        "calibration": ["matplotlib>=3.7", "scipy>=1.14"],
        "completion": ["argcomplete>=3"],
        "descriptions": DESCRIPTIONS,
        "geometry": GEOMETRY,
        "many": MANY,
        "mjcf": MJCF,
        "replay": ["mcap-ros2-support>=0.5"],
        "view": VIEW,
        "test": [
            *MANY,
            *MJCF,
            *VIEW,
            "argcomplete>=3",
            "hypothesis>=6",
            "import-linter>=2",
            "jsonschema>=4.18",
            "mypy>=1.10",
            "playwright>=1.45",
            "pyright[nodejs]>=1.1.407",
            "pytest>=7",
            "ruff",
        ],
    },
    entry_points={"console_scripts": [f"{NAME} = {NAME}.__main__:main"]},
    zip_safe=False,
)
