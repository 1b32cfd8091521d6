#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a part of the benchmark by its name, or `all`. If the tools for the comparison are missing,
# the script first installs them into .venv.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

install_peers() {
    [ -d .venv ] || {
        echo >&2 'setup: what the benchmark compares with is installed into .venv, beside the' \
            'wheels of ROS 2, not beside a full install: take a shell that has not sourced one.'
        exit 1
    }
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
        echo >&2 'setup: heyoka and MuJoCo, with which the benchmark compares, have wheels for' \
            'Python 3.11 and later: make clean, and the same with PYTHON=/path/to/python3.12.'
        exit 1
    }
    echo 'Installing what the benchmark compares with into .venv: 130 MB.'
    python3 -m pip install --quiet --constraint setup/constraints.txt \
        --requirement setup/requirements-benchmark.txt
}

python3 -c 'import heyoka, mcap, mujoco, numba' 2>/dev/null || install_peers
parts=$1
[ "$parts" != all ] ||
    parts=$(PYTHONPATH=benchmark python3 -c 'import comparison; print(*comparison.PARTS)')
for part in $parts; do
    [ -f "benchmark/$part.py" ] || { echo >&2 "ONLY=$part: there is no benchmark/$part.py"; exit 1; }
    python3 "benchmark/$part.py" "${@:2}"
done
