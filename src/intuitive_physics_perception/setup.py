from setuptools import find_packages, setup

package_name = "intuitive_physics_perception"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    python_requires=">=3.10",
    install_requires=[
        "setuptools",
        "intuitive_physics",
        "numpy>=1.26",
        "numba>=0.58",
        "pillow",
        "scipy",
    ],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="From depth images or point clouds to environment, object states, observations",
    license="Apache-2.0",
    entry_points={
        # It ends clean at a signal from its first moment on, and finds the node by its name.
        "console_scripts": [
            "perception_node = intuitive_physics_ros.lifecycle.start_node:main",
            "pose_bridge_node = intuitive_physics_ros.lifecycle.start_node:main",
        ],
        "intuitive_physics.nodes": [
            "perception_node = intuitive_physics_perception.nodes.perception_node:main",
            "pose_bridge_node = intuitive_physics_perception.nodes.pose_bridge_node:main",
        ],
    },
)
