from setuptools import find_packages, setup

package_name = "intuitive_physics_ros"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools", "numpy>=1.26", "scipy"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Message conversions and node plumbing of the intuitive physics suite",
    license="Apache-2.0",
)
