#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a benchmark by its name, after installing what it compares with, unless that is done.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! python3 -c 'import heyoka, mujoco, numba' 2>/dev/null; then
    [ -d .venv ] || {
        echo >&2 'setup: the benchmark needs the wheels in .venv, not a full ROS 2 install:' \
            'run it in a shell that has not sourced one.'
        exit 1
    }
    echo 'Installing what the benchmark compares with into .venv.'
    python3 -m pip install --quiet --constraint setup/constraints.txt \
        --requirement setup/requirements-benchmark.txt
fi
[ -f "benchmark/$1.py" ] || { echo >&2 "ONLY=$1: there is no benchmark/$1.py"; exit 1; }
exec python3 "benchmark/$1.py" "${@:2}"
