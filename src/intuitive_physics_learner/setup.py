from setuptools import find_packages, setup

package_name = "intuitive_physics_learner"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    entry_points={
        # It ends clean at a signal from its first moment on, and finds the node by its name.
        "console_scripts": ["learner_node = intuitive_physics_ros.lifecycle.start_node:main"],
        "intuitive_physics.nodes": [
            "learner_node = intuitive_physics_learner.nodes.learner_node:main"
        ],
    },
    python_requires=">=3.10",
    install_requires=["setuptools", "intuitive_physics", "numpy>=1.26", "scipy", "cma"],
    extras_require={
        "cluster": ["distributed"],
        "test": ["pytest", "hypothesis", "pyyaml", "distributed", "pybullet"],
    },
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Learning material parameters from observed trajectories",
    license="Apache-2.0",
)
