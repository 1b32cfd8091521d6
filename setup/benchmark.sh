#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a part of the benchmark by its name, or `all`, after installing what it compares with,
# unless that is done.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

setup/peers.sh
parts=$1
[ "$parts" != all ] ||
    parts=$(PYTHONPATH=benchmark python3 -c 'import comparison; print(*comparison.PARTS)')
for part in $parts; do
    [ -f "benchmark/$part.py" ] || { echo >&2 "ONLY=$part: there is no benchmark/$part.py"; exit 1; }
    python3 "benchmark/$part.py" "${@:2}"
done
