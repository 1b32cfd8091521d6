#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the workspace into install/, unless nothing in src/ has changed since it was built.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. setup/home.sh
. setup/run.sh

# One at a time: whoever comes second finds it done.
exec 9<src
flock 9

if ! cmp -s "$soliton_home/installed" install/built; then
    rm -rf build install
else
    changed=$(find src bags colcon.meta setup/build.sh -newer install/built ! -name __pycache__ \
        ! -name '*.pyc' ! -name '*.nb[ci]')
    if [ -z "$changed" ]; then
        # Settings need no build.
        cp config/*.yaml config/*.xml install/share/soliton_linkage_nodes/config
        cp config/studies/*.yaml install/share/soliton_linkage_studies/settings
        exit 0
    fi
fi

# What setup.py once installed it never removes. The compiled messages are kept in build/.
rm -rf install build/soliton_linkage build/soliton_linkage_studies build/soliton_linkage_nodes
mkdir -p install
cp "$soliton_home/installed" install/building

. setup/compiler.sh

echo 'Building the workspace: a minute the first time, half of it after a change.'
build() {
    colcon --log-level error build --base-paths src --merge-install \
        --event-handlers console_stderr- summary- "$@"
}

# Loops are compiled as they are imported: now, once, rather than when the first node starts.
compile_loops() {
    . setup/environment.sh
    echo 'Compiling loops.'
    grep -rl --include='*.py' 'soliton_linkage.compiling import' \
        src/soliton_linkage/soliton_linkage src/soliton_linkage_studies/soliton_linkage_studies |
        sed 's,^src/[^/]*/,,; s/\.py$//; s,/,.,g' | python3 -c '
import importlib, sys
from soliton_linkage.dynamics.integrators import SymplecticNystrom
for name in sys.stdin.read().split():
    importlib.import_module(name)
SymplecticNystrom.load()'
}

# The physics first: its loops are compiled beside the messages.
build_all() {
    local loops status=0
    build --packages-select soliton_linkage soliton_linkage_studies || return
    (compile_loops) & loops=$!
    build --packages-skip soliton_linkage soliton_linkage_studies "${cmake_arguments[@]}" || status=$?
    wait "$loops" || status=$?
    return "$status"
}

if ! run build_all; then
    for result in $(grep -Lx 0 build/*/colcon_build.rc); do
        tail -n 25 "log/latest_build/$(basename "$(dirname "$result")")/stderr.log" >&2
    done
    printf '\nsetup: the build failed; %s\n    %s\n' 'above is the end of what it said.' \
        'If that names no file in src/, start afresh: make clean, and the same command again.' >&2
    exit 1
fi
mv install/building install/built
