"""Install lowcostnav_ros with pip or colcon; metadata lives here because ament_python reads setup.py."""

import sys
from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup

NAME = "lowcostnav_ros"
EXECUTABLE = '''#!/usr/bin/env python3
"""Run the executable under whose name this file is installed."""

import sys
from pathlib import Path

from lowcostnav_ros.nodes.dispatch import main

sys.exit(main(Path(sys.argv[0]).name, sys.argv[1:]))
'''


class Package(Distribution):
    """A package whose data files are installed in an editable installation, too."""

    def has_data(self) -> bool:
        """Setuptools asks this before it installs them."""
        return True


def executables() -> list[str]:
    """Make one file for every executable, the same script under every name, and return their paths.

    `ros2 run` looks for them in lib/<package>.  They are those that have a parameter file, and the monitor.
    """
    names = {"monitor", *(path.stem for path in Path("config").glob("*.yaml"))}
    folder = Path("build/executables")
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_text(EXECUTABLE)
        (folder / name).chmod(0o755)
    return [f"{folder.as_posix()}/{name}" for name in sorted(names)]


def shared_files(folder: str, patterns: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """List ``folder`` and its subfolders as data_files entries under share/lowcostnav_ros."""
    folders = [Path(folder), *sorted(p for p in Path(folder).rglob("*") if p.is_dir() and p.name != "__pycache__")]
    found = [(f"share/{NAME}/{p.as_posix()}", sorted(f for g in patterns for f in glob(f"{p.as_posix()}/{g}"))) for p in folders]
    return [entry for entry in found if entry[1]]


data_files = [("share/ament_index/resource_index/packages", [f"resource/{NAME}"]), (f"lib/{NAME}", executables())]
if "editable_wheel" not in sys.argv:  # an editable installation reads these where they are edited
    data_files += [
        (f"share/{NAME}", ["package.xml"]),
        *shared_files("config", ("*.yaml", "*.csv", "*.xml", "*.npz", "*.rules", "*.json", "*.service")),
        *shared_files("launch", ("*.launch.py",)),
    ]

setup(
    name=NAME,
    version="0.1.0",
    description="Low-cost aircraft navigation, with GPS and without, on ROS 2",
    license="Apache-2.0",
    maintainer="lowcostnav_ros maintainers",
    maintainer_email="maintainers@lowcostnav-ros.example",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={f"{NAME}.report": ["*.css", "*.js"], f"{NAME}.graph.page": ["assets/*"]},
    python_requires=">=3.11",
    zip_safe=False,
    data_files=data_files,
    distclass=Package,
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "numba>=0.60",
        "PyYAML>=6.0",
        "rich>=13.0",
        "rosbags>=0.11",
        "pygeomag>=1.1",
        "jsbsim>=1.2",
        "filterpy>=2.0",
        "matplotlib>=3.8",
        "pyulog>=1.2",
    ],
    extras_require={
        # an extra, not a requirement: on apt Jazzy these wheels would shadow the system's own packages
        "ros": ["ros-jazzy-rclpy==7.1.6", "ros-jazzy-common-interfaces==5.3.6", "ros-jazzy-rmw-fastrtps-cpp==8.4.3"],
        "bags": ["mcap>=1.2"],
        "drivers": ["pyserial>=3.5"],
        "foxglove": ["foxglove-sdk>=0.30"],
        "cluster": ["dask[distributed]>=2024.5"],
        "test": [
            "pytest>=8",
            "pytest-timeout>=2.3",
            "pytest-xdist>=3.5",
            "hypothesis>=6.100",
            "pymap3d>=3.1",
            "AllanTools>=2024.6",
            "AHRS>=0.3.1",
            "ruff>=0.6",
            "import-linter>=2.0",
            "mypy>=1.15",
            "types-PyYAML>=6.0",
        ],
    },
    entry_points={"console_scripts": ["lowcostnav = lowcostnav_ros.cli.main:main"]},
)
