# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash: puts ROS 2 and Python on the path. A sourced full ROS 2 is used, otherwise
# the wheels in .venv.

# Without bytecode, each program would parse its imports again. For numba this takes 1.3 s.
unset PYTHONDONTWRITEBYTECODE

soliton_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# ROS logs and caches of other packages need a home that can be written.
if [ ! -w "${HOME:-/nowhere}" ]; then
    export HOME=$soliton_root/out/home
    mkdir -p "$HOME"
fi

if [ "$ROS_DISTRO" = jazzy ]; then
    soliton_home=$soliton_root/.python
    if [ -z "$AMENT_PREFIX_PATH" ] && [ -f /opt/ros/jazzy/setup.bash ]; then
        . /opt/ros/jazzy/setup.bash
    elif [ -z "$AMENT_PREFIX_PATH" ]; then
        echo 'ROS_DISTRO is jazzy, but AMENT_PREFIX_PATH is empty:' \
            'source the setup.bash of the ROS install, or unset ROS_DISTRO.' >&2
        return 1
    fi
    export PATH=$soliton_home/bin:$PATH PYTHONPATH=$soliton_home${PYTHONPATH:+:$PYTHONPATH}
elif [ -n "$ROS_DISTRO" ]; then
    echo "ROS_DISTRO is '$ROS_DISTRO', but the suite runs on jazzy only:" \
        'use a shell that has sourced ROS 2 jazzy, or no ROS 2.' >&2
    return 1
else
    soliton_home=$soliton_root/.venv
    # The value of another environment would keep our wheels from finding their libraries.
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
    if [ -f "$soliton_home/bin/activate" ]; then
        . "$soliton_home/bin/activate"
        export AMENT_PREFIX_PATH=$soliton_home CMAKE_PREFIX_PATH=$soliton_home
    fi
fi
