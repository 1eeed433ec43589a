from setuptools import find_packages, setup

package_name = "intuitive_physics_cli"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    entry_points={
        "console_scripts": ["intuitive-physics = intuitive_physics_cli.command_line:main"]
    },
    install_requires=[
        "setuptools",
        "intuitive_physics",
        "intuitive_physics_learner",
        "intuitive_physics_perception",
        "intuitive_physics_predictor",
        "intuitive_physics_recordings",
        "matplotlib",
        "numpy>=1.26",
        # No rosdep key names it, so package.xml cannot.
        "plotly",
    ],
    extras_require={"rerun": ["rerun-sdk"], "test": ["pytest", "hypothesis"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="The command line: perceive, learn, predict, report, import, export",
    license="Apache-2.0",
)
