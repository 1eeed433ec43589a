#!/usr/bin/env bash
# Puts src/ into the environment, where everything runs with nothing sourced: colcon builds the messages,
# the rest are links, so that a change in a Python file takes effect at once.
set -euo pipefail
prefix=$PWD/.venv

# Of the two packages alone: colcon would ask for the others, which the examples need when they run.
# Neither another ROS that is sourced nor the user's own colcon defaults may get into it.
build() {
    env -u PYTHONPATH -u PYTHONHOME -u PYTHONDONTWRITEBYTECODE -u LD_LIBRARY_PATH \
        -u CMAKE_PREFIX_PATH -u COLCON_PREFIX_PATH -u ROS_DISTRO \
        PATH="$prefix/bin:$PATH" AMENT_PREFIX_PATH="$prefix" COLCON_HOME="$PWD/build/colcon_home" \
        colcon --log-base build/log --log-level error build \
        --base-paths src/intuitive_physics_msgs src/intuitive_physics_examples \
        --build-base build/colcon --install-base "$prefix" --merge-install \
        --event-handlers console_start_end- summary- "$@" \
        --cmake-args -G Ninja -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release \
        -DPython3_EXECUTABLE="$prefix/bin/python" \
        -DCMAKE_PROJECT_INCLUDE="$PWD/tools/ros_wheels.cmake"
}

echo "set-up: building the workspace"
# What is gone from src/ must not stay.
rm -rf "$prefix"/bin/intuitive-physics "$prefix"/{lib,lib/python3*/site-packages,share}/intuitive_physics*
build --packages-select intuitive_physics_msgs
build --packages-select intuitive_physics_examples --symlink-install
PIP_USER=0 "$prefix/bin/python" -m pip --disable-pip-version-check install -qq \
    --no-deps --no-build-isolation --editable .
"$prefix/bin/python" -m tools.link_packages
