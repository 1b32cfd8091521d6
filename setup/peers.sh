#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what the benchmark compares with into .venv, unless that is done.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

! python3 -c 'import heyoka, mcap, mujoco, numba' 2>/dev/null || exit 0
[ -d .venv ] || {
    echo >&2 'setup: what the benchmark compares with is installed into .venv, beside the wheels' \
        'of ROS 2, not beside a full install: take a shell that has not sourced one.'
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
