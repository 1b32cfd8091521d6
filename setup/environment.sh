# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash: puts ROS 2, Python and the nodes on the path, once they are built.

. "$(dirname "${BASH_SOURCE[0]}")/home.sh" || return 1

if [ -f "$soliton_root/install/local_setup.bash" ]; then
    . "$soliton_root/install/local_setup.bash"
    export PATH=$soliton_root/install/lib/soliton_linkage_nodes:$PATH
fi

unset soliton_home soliton_root
