# The suite on ROS 2 Jazzy from apt. Untested: it was written where no container can be built.
#   docker build -t intuitive_physics . && docker run --rm -it --net=host --ipc=host intuitive_physics \
#       ros2 launch intuitive_physics_bringup intuitive_physics.launch.py
FROM ros:jazzy
SHELL ["/bin/bash", "-c"]
ENV PIP_BREAK_SYSTEM_PACKAGES=1
WORKDIR /workspace
COPY src src
RUN apt-get update \
    && apt-get install -y --no-install-recommends g++ python3-dev python3-pip \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src --rosdistro jazzy -y \
    && rm -rf /var/lib/apt/lists/*
RUN pip install cma distributed lz4 plotly scoringrules
RUN source /opt/ros/jazzy/setup.bash && colcon build --base-paths src
RUN sed -i '/^exec /i source /workspace/install/setup.bash' /ros_entrypoint.sh
CMD ["bash"]
