from setuptools import find_packages, setup

package_name = "intuitive_physics_experiments"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    entry_points={
        "console_scripts": ["demo = intuitive_physics_experiments.demo.nodes.run_demo:main"],
        "intuitive_physics_cli.commands": [
            "calibrate = intuitive_physics_experiments.commands.calibrate_command",
            "evaluate = intuitive_physics_experiments.commands.evaluate_command",
            "experiment = intuitive_physics_experiments.commands.experiment_command",
            "render = intuitive_physics_experiments.commands.render_command",
        ],
        "intuitive_physics_cli.observation_readers": [
            "npz = intuitive_physics_experiments.recorded_sets.recorded_data:load_recorded_set"
        ],
        "intuitive_physics_cli.engines": [
            "mujoco = intuitive_physics_experiments.engines.mujoco_simulator:MujocoSimulator"
        ],
    },
    python_requires=">=3.10",
    install_requires=[
        "setuptools",
        "intuitive_physics",
        "intuitive_physics_cli",
        "intuitive_physics_learner",
        "intuitive_physics_perception",
        "intuitive_physics_predictor",
        "intuitive_physics_recordings",
        "matplotlib",
        "numpy>=1.26",
        "pillow",
        "scipy",
    ],
    extras_require={
        "render": ["open3d", "pybullet"],
        "peers": ["mujoco", "pybullet"],
        "test": ["pytest", "hypothesis"],
    },
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Synthetic and recorded data, RGBD renderer, the paper's experiments, demo",
    license="Apache-2.0",
)
