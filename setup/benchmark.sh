#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a part of the benchmark by its name, or `all`, after installing what it compares with,
# unless that is done.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! python3 -c 'import heyoka, mcap, mujoco, numba' 2>/dev/null; then
    [ -d .venv ] || {
        echo >&2 'setup: the benchmark needs the wheels in .venv, not a full ROS 2 install:' \
            'run it in a shell that has not sourced one.'
        exit 1
    }
    echo 'Installing what the benchmark compares with into .venv.'
    python3 -m pip install --quiet --constraint setup/constraints.txt \
        --requirement setup/requirements-benchmark.txt
fi
parts=$1
[ "$parts" != all ] ||
    parts=$(PYTHONPATH=benchmark python3 -c 'import comparison; print(*comparison.PARTS)')
for part in $parts; do
    [ -f "benchmark/$part.py" ] || { echo >&2 "ONLY=$part: there is no benchmark/$part.py"; exit 1; }
    python3 "benchmark/$part.py" "${@:2}"
done
