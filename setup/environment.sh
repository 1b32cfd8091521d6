# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash: puts ROS 2, Python and the nodes on the path, once they are built.

. "$(dirname "${BASH_SOURCE[0]}")/home.sh" || return 1

if [ -f "$soliton_root/install/local_setup.bash" ]; then
    . "$soliton_root/install/local_setup.bash"
    export PATH=$soliton_root/install/lib/soliton_linkage_nodes:$PATH
fi

# No other machine sees the nodes, unless ROS_AUTOMATIC_DISCOVERY_RANGE says which ones do; its
# LOCALHOST alone leaves sockets of Fast DDS open to all.
if [ -z "$ROS_AUTOMATIC_DISCOVERY_RANGE$FASTRTPS_DEFAULT_PROFILES_FILE" ]; then
    case ${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp} in
        rmw_fastrtps*)
            export FASTRTPS_DEFAULT_PROFILES_FILE=$soliton_root/config/loopback.xml
            export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
            ;;
        *) export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ;;
    esac
fi

unset soliton_home soliton_root
