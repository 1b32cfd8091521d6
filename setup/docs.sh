#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the site into out/docs; installs what that takes beside all else, unless it is there.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! python3 -c 'import furo, myst_parser, sphinx' 2>/dev/null; then
    echo 'Installing Sphinx, with which the documentation is built: 90 MB.'
    where=()
    [ "$ROS_DISTRO" != jazzy ] || where=(--target .python)
    python3 -m pip install --quiet "${where[@]}" --constraint setup/constraints.txt \
        --requirement setup/requirements-docs.txt || {
        echo >&2 'setup: pip could not install Sphinx: check the connection to a Python package' \
            'index, and run the same command again.'
        exit 1
    }
fi
python3 -m sphinx --fail-on-warning --keep-going --quiet --builder html "$@" docs out/docs
echo 'The documentation is in out/docs/index.html.'
