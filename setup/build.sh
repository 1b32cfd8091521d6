#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the workspace into install/, unless src/ is unchanged since the last build.
# `build.sh demo` compiles only the loops of the simulation and of the analyser.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. setup/home.sh
. setup/run.sh

# One process builds at a time. A second one waits, and finds the workspace built.
exec 9<src
flock 9

others=(src/soliton_linkage/soliton_linkage/{identification,vision}
    src/soliton_linkage_studies/soliton_linkage_studies)

# Numba compiles a loop when its module is imported. Nodes must not wait for this.
compile_loops() {
    (. setup/environment.sh && python3 setup/compile_loops.py "$@")
}

compile_other_loops() {
    echo 'Compiling the other loops.'
    compile_loops "${others[@]}"
    touch install/loops
}

if ! cmp -s "$soliton_home/installed" install/built; then
    rm -rf build install
else
    changed=$(find src bags colcon.meta setup/build.sh -newer install/built ! -name __pycache__ \
        ! -name '*.pyc' ! -name '*.nb[ci]')
    if [ -z "$changed" ]; then
        # Settings need no build.
        cp config/*.yaml config/*.xml install/share/soliton_linkage_nodes/config
        cp config/studies/*.yaml install/share/soliton_linkage_studies/settings
        [ "$1" = demo ] || [ -e install/loops ] || run compile_other_loops
        exit 0
    fi
fi

# setup.py does not remove files of earlier versions. Compiled messages remain in build/.
rm -rf install build/soliton_linkage build/soliton_linkage_studies build/soliton_linkage_nodes
mkdir -p install
cp "$soliton_home/installed" install/building

. setup/compiler.sh

echo 'Building the workspace: a minute the first time, half of it after a change.'
build() {
    colcon --log-level error build --base-paths src --merge-install \
        --event-handlers console_stderr- summary- "$@"
}

# All other requirements are installed while the messages compile. Then loops are compiled.
build_all() {
    local rest messages status=0 physics=(soliton_linkage soliton_linkage_studies)
    setup/install.sh run & rest=$!
    build --packages-select "${physics[@]}" || { kill "$rest"; return 1; }
    build --packages-skip "${physics[@]}" "${cmake_arguments[@]}" & messages=$!
    if wait "$rest"; then
        echo 'Compiling loops.'
        (. setup/environment.sh && python3 setup/first_imports.py) &
        compile_loops src/soliton_linkage/soliton_linkage/{dynamics,estimation,orbit} || status=$?
        [ "$demo" ] || compile_other_loops || status=$?
    else
        status=3
    fi
    wait "$messages" || status=$?
    return "$status"
}

[ "$1" != demo ] || demo=yes
status=0
run build_all || status=$?
[ "$status" != 3 ] || exit 1  # the installation has reported why
if [ "$status" != 0 ]; then
    for result in $(grep -Lx 0 build/*/colcon_build.rc); do
        tail -n 25 "log/latest_build/$(basename "$(dirname "$result")")/stderr.log" >&2
    done
    printf '\nsetup: the build failed; %s\n    %s\n' 'above is the end of what it said.' \
        'If that names no file in src/, start afresh: make clean, and the same command again.' >&2
    exit 1
fi
mv install/building install/built
