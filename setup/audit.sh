#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Asks the database of known vulnerabilities of Python packages about the pins of setup/. That
# takes a connection, and pip-audit, which is installed beside all else, into out/audit.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

python3 setup/pins.py
home=out/audit
[ -x "$home/bin/pip-audit" ] || {
    python3 -m venv --clear "$home"
    "$home/bin/python3" -m pip install --quiet pip-audit || {
        echo >&2 'setup: pip could not install pip-audit: check the connection to a Python package' \
            'index, and run the same command again.'
        exit 1
    }
}
exec "$home/bin/pip-audit" --requirement setup/constraints.txt --no-deps --disable-pip \
    --progress-spinner off "$@"
