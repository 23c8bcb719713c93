"""ament_python package: `colcon build` beside uw_acoustic_loc, or `pip install .`."""

from setuptools import setup

NAME = "four_hydrophones"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    package_data={NAME: ["*.msg"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "graph.yaml", "params.yaml"]),
    ],
    install_requires=["uw_acoustic_loc"],
    entry_points={
        "uw_acoustic_loc.stages": [f"bearing4 = {NAME}.stage:FourBearingStage"],
        "console_scripts": ["bearing4 = uw_acoustic_loc.ros.executables:script"],
    },
)
