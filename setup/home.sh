# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash: puts ROS 2 and Python on the path, of a full ROS 2 install where one is
# sourced, else of the wheels in .venv.

# Every program would parse all that it imports again, numba for 1.3 s.
unset PYTHONDONTWRITEBYTECODE

soliton_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# Logs of ROS, and the caches of others, need a home.
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
    # What the wheels of another environment have set keeps ours from finding their libraries.
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
    if [ -f "$soliton_home/bin/activate" ]; then
        . "$soliton_home/bin/activate"
        export AMENT_PREFIX_PATH=$soliton_home CMAKE_PREFIX_PATH=$soliton_home
    fi
fi
