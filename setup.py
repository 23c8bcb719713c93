"""ament_python package: installs with pip, with `colcon build`, and in place with `pip install -e .`."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "uw_acoustic_loc"
NODES = [
    "vehicle_driver",
    "hydrophone_driver",
    "buoy_driver",
    "sonar_driver",
    "bearing",
    "bearing_localizer",
    "bearing_slam",
    "toa_tracker",
    "multistatic_fusion",
    "mooring_tracker",
    "recorder",
    "player",
]


def shared(folder: str) -> list[tuple[str, list[str]]]:
    """Data files below a folder, for share/uw_acoustic_loc/."""
    folders = [path for path in [Path(folder), *Path(folder).rglob("*")] if path.is_dir()]
    files = [(path, sorted(str(file) for file in path.iterdir() if file.is_file())) for path in folders]
    return [(f"share/{NAME}/{path}", names) for path, names in files if names]


setup(
    name=NAME,
    version="0.1.0",
    description="Acoustic localization for AUVs: bearings, positions and tracks, live on ROS 2 and from bags",
    license="Apache-2.0",
    author="uw_acoustic_loc maintainers",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *shared("msg_defs"),
        *shared("config"),
    ],
    python_requires=">=3.11",
    install_requires=[
        "numpy>=1.26,<3",
        "scipy>=1.11,<2",
        "PyYAML>=6,<7",
        "rich>=13,<16",
        "matplotlib>=3.6,<4",
        "rosbags>=0.10,<1",
        "mcap>=1.5,<2",
        "lz4>=3",  # these two: what mcap compresses with
        "zstandard>=0.20",
        "soundfile>=0.12,<1",
    ],
    extras_require={
        # rclpy and the standard messages, for machines without a ROS 2 distribution
        "ros": ["ros-jazzy-rclpy[fastrtps]>=7.1,<8", "ros-jazzy-common-interfaces>=5.3,<6"],
        "test": [
            "pytest>=8",
            "pytest-xdist>=3",
            "hypothesis>=6",
            "ruff>=0.6",
            "mypy>=1.11",
            "types-PyYAML",
            "scipy-stubs",
            "colcon-common-extensions",
        ],
    },
    zip_safe=False,
    entry_points={
        "console_scripts": [
            f"uwloc = {NAME}.cli.main:main",
            *[f"{node} = {NAME}.ros.executables:script" for node in NODES],
        ]
    },
)
