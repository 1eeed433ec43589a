#!/usr/bin/env bash
# Builds src/ with colcon into the environment's prefix, where everything runs with nothing sourced.
set -euo pipefail
prefix=$PWD/.venv

echo "set-up: building the workspace"
# Left alone, setuptools would install modules again that are gone from src/.
rm -rf build/colcon/*/build
# Neither another ROS that is sourced nor the user's own colcon defaults may get into it.
env -u PYTHONPATH -u PYTHONHOME -u PYTHONDONTWRITEBYTECODE -u LD_LIBRARY_PATH \
    -u CMAKE_PREFIX_PATH -u COLCON_PREFIX_PATH -u ROS_DISTRO \
    PATH="$prefix/bin:$PATH" AMENT_PREFIX_PATH="$prefix" COLCON_HOME="$PWD/build/colcon_home" \
    colcon --log-base build/log --log-level error build \
    --base-paths src --build-base build/colcon --install-base "$prefix" --merge-install \
    --event-handlers console_start_end- \
    --cmake-args -G Ninja -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release \
    -DPython3_EXECUTABLE="$prefix/bin/python" \
    -DCMAKE_PROJECT_INCLUDE="$PWD/tools/ros_wheel_paths.cmake"

command_line=lib/intuitive_physics_cli/intuitive-physics
if [ -e ".venv/$command_line" ]; then ln -sfn "../$command_line" .venv/bin/intuitive-physics; fi
