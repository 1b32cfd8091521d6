# SPDX-License-Identifier: Apache-2.0
# The suite in a container: Ubuntu 24.04, the packages of ROS 2 Jazzy, and a colcon workspace.
#
#     docker build --tag soliton_linkage .
#     docker run --rm --interactive --tty --network host soliton_linkage
#
# test/test_package_lists.py compares the packages with the dependencies in src/*/package.xml.
FROM ros:jazzy-ros-base-noble

RUN apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install --no-install-recommends --yes \
    build-essential \
    python3-argcomplete \
    python3-colcon-common-extensions \
    python3-matplotlib \
    python3-numba \
    python3-numpy \
    python3-opencv \
    python3-pip \
    python3-scipy \
    python3-serial \
    python3-yaml \
    ros-jazzy-action-msgs \
    ros-jazzy-ament-cmake \
    ros-jazzy-ament-index-python \
    ros-jazzy-builtin-interfaces \
    ros-jazzy-diagnostic-msgs \
    ros-jazzy-domain-coordinator \
    ros-jazzy-geometry-msgs \
    ros-jazzy-launch \
    ros-jazzy-launch-ros \
    ros-jazzy-lifecycle-msgs \
    ros-jazzy-rcl-interfaces \
    ros-jazzy-rclpy \
    ros-jazzy-rosgraph-msgs \
    ros-jazzy-rosidl-default-generators \
    ros-jazzy-rosidl-default-runtime \
    ros-jazzy-sensor-msgs \
    ros-jazzy-std-msgs \
    ros-jazzy-std-srvs \
    ros-jazzy-trajectory-msgs \
    ros-jazzy-visualization-msgs \
    && rm -rf /var/lib/apt/lists/*
# Ubuntu protects its Python from pip (PEP 668). In a container nothing else uses this Python.
RUN python3 -m pip install --break-system-packages --no-cache-dir rosbags

WORKDIR /soliton_linkage
COPY . .
RUN . /opt/ros/jazzy/setup.sh && colcon build --base-paths src --merge-install
# Nodes would otherwise compile these loops at each start of a container.
RUN . install/setup.sh && python3 -c 'import soliton_linkage.estimation.filter_bank; \
from soliton_linkage.dynamics.integrators import SymplecticNystrom; SymplecticNystrom.load()'

RUN echo '. /soliton_linkage/install/setup.bash' >> /root/.bashrc
CMD ["bash"]
