# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
#
# The ROS packages on ROS 2 Jazzy (Ubuntu 24.04), as docs/ros_workspace.md builds them by hand.
# Written and checked for syntax by the tests; not built by the authors yet.
#   docker build -t rpo . && docker run --rm rpo

FROM ros:jazzy AS dependencies
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /ws
COPY ros_ws/src /tmp/src
# RViz is left out: it is large, and a container has no screen.
RUN apt-get update && apt-get install -y --no-install-recommends python3-pip \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths /tmp/src --ignore-src -y --skip-keys rviz2 \
    && rm -rf /tmp/src /var/lib/apt/lists/*
RUN python3 -m pip install --user --break-system-packages --no-cache-dir mcap

FROM dependencies AS flight
COPY ros_ws/src src/rpo
RUN source /opt/ros/jazzy/setup.bash && colcon build
RUN sed -i '/^exec/i source /ws/install/setup.bash' /ros_entrypoint.sh
CMD ["ros2", "run", "rpo_bringup", "final_approach", "--scenario", "quick", "--output", "/tmp/run"]
