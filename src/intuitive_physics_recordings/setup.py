from setuptools import find_packages, setup

package_name = "intuitive_physics_recordings"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["message_definitions/*.msg"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    entry_points={
        # It ends clean at a signal from its first moment on, and finds the node by its name.
        "console_scripts": ["replay_node = intuitive_physics_ros.lifecycle.start_node:main"],
        "intuitive_physics.nodes": [
            "replay_node = intuitive_physics_recordings.nodes.replay_node:main"
        ],
    },
    install_requires=["setuptools", "intuitive_physics", "lz4", "numpy>=1.26", "pyyaml", "rosbags"],
    extras_require={"test": ["pytest", "hypothesis"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Bags in and out, observation files, replay",
    license="Apache-2.0",
)
