"""Install lowcostnav_ros with pip or colcon; metadata lives here because ament_python reads setup.py."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "lowcostnav_ros"
NODES = [
    "truth_source",
    "imu_simulator",
    "magnetometer_simulator",
    "air_data_simulator",
    "gps_simulator",
    "dme_simulator",
    "vor_simulator",
    "gps_attitude_simulator",
    "gnss_simulator",
    "ahrs",
    "dead_reckoning",
    "ins_gps",
    "gnss_only",
    "ins_gnss",
    "supervisor",
    "recorder",
    "player",
    "monitor",
]


def shared_files(folder: str, patterns: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """List ``folder`` and its subfolders as data_files entries under share/lowcostnav_ros."""
    folders = [Path(folder), *sorted(p for p in Path(folder).rglob("*") if p.is_dir() and p.name != "__pycache__")]
    found = [(f"share/{NAME}/{p.as_posix()}", sorted(f for g in patterns for f in glob(f"{p.as_posix()}/{g}"))) for p in folders]
    return [entry for entry in found if entry[1]]


setup(
    name=NAME,
    version="0.1.0",
    description="Low-cost aircraft navigation, with GPS and without, on ROS 2",
    license="Apache-2.0",
    maintainer="lowcostnav_ros maintainers",
    maintainer_email="maintainers@lowcostnav-ros.example",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    python_requires=">=3.11",
    zip_safe=False,
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *shared_files("config", ("*.yaml", "*.csv")),
        *shared_files("launch", ("*.launch.py",)),
        # `ros2 run` looks in lib/<package>; wheels put console scripts only in bin/
        (f"lib/{NAME}", sorted(glob("scripts/*"))),
    ],
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
    ],
    extras_require={
        # an extra, not a requirement: on apt Jazzy these wheels would shadow the system's own packages
        "ros": ["ros-jazzy-rclpy==7.1.6", "ros-jazzy-common-interfaces==5.3.6", "ros-jazzy-rmw-fastrtps-cpp==8.4.3"],
        "bags": ["mcap>=1.2"],
        "drivers": ["pyserial>=3.5", "pynmeagps>=1.0", "pyubx2>=1.2"],
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
    entry_points={"console_scripts": ["lowcostnav = lowcostnav_ros.cli.main:main", *(f"{n} = {NAME}.nodes.{n}:main" for n in NODES)]},
)
