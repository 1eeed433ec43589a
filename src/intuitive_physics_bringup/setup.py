from glob import glob

from setuptools import find_packages, setup

package_name = "intuitive_physics_bringup"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
        ("share/" + package_name + "/launch", glob("launch/*.py")),
        ("share/" + package_name + "/config", glob("config/*")),
        ("share/" + package_name + "/foxglove", glob("foxglove/*.json")),
        ("share/" + package_name + "/rviz", glob("rviz/*.rviz")),
        ("share/" + package_name + "/security", ["security/policy.xml"]),
    ],
    scripts=["security/make_keystore"],
    python_requires=">=3.10",
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Launch files and configuration of the intuitive physics suite",
    license="Apache-2.0",
)
