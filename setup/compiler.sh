# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash after home.sh: CMake and make options for the messages.

# shellcheck disable=SC2034
cmake_arguments=(--cmake-args)
# The wheels contain no rclcpp.
[ "$ROS_DISTRO" = jazzy ] || cmake_arguments+=(-DPYTHON_ALONE=ON)
headers=("$soliton_home"/headers/usr/include/python3*)
if [ -d "${headers[0]}" ]; then
    cmake_arguments+=("-DPython3_INCLUDE_DIR=${headers[0]}")
    export CPATH=$soliton_home/headers/usr/include
fi

unset MAKELEVEL MFLAGS
# Without this variable make runs one job at a time on a machine with other load.
MAKEFLAGS=-j$(nproc)
export MAKEFLAGS
