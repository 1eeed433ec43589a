from setuptools import find_packages, setup

package_name = "intuitive_physics"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools", "numpy>=1.26", "numba>=0.58", "scipy"],
    extras_require={"bullet": ["pybullet"], "test": ["pytest", "hypothesis"]},
    zip_safe=False,
    maintainer="Intuitive Physics maintainers",
    maintainer_email="maintainers@intuitive-physics.example",
    description="Shapes, states, materials, observations and simulation of rigid bodies",
    license="Apache-2.0",
)
