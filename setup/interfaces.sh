#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the tests of services beside rosbag2_interfaces and simulation_interfaces: those that are
# installed, else stand-ins, built from test/interfaces into a workspace of their own.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. setup/home.sh
. setup/run.sh
. setup/compiler.sh
place=build/interfaces

build() {
    mkdir -p "$place"
    colcon --log-level error --log-base "$place/log" build --base-paths test/interfaces \
        --merge-install --build-base "$place/build" --install-base "$place/install" \
        --event-handlers console_stderr- summary- "${cmake_arguments[@]}"
}

if ! python3 -c 'import rosbag2_interfaces.srv, simulation_interfaces.srv' 2>/dev/null; then
    run build
fi
. setup/environment.sh
[ ! -f "$place/install/local_setup.bash" ] || . "$place/install/local_setup.bash"
exec python3 -m pytest --quiet test/nodes/simulator/test_standard_package.py \
    test/nodes/bags/test_{services,player,recorder}.py \
    -k 'pause or seek or sought or rate_is or split_when or snapshot or service or standard'
