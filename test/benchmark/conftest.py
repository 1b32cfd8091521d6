# SPDX-License-Identifier: Apache-2.0
"""The tests of a part of the benchmark look at one short run of it."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAMS = Path(__file__).parents[2] / 'benchmark'
LONGEST_RUN = 300.0

sys.path.append(str(PROGRAMS))


@pytest.fixture(scope='session')
def run_part(request, tmp_path_factory):
    """Run a part by its name and return its output; show its messages if it fails."""
    if not request.config.getoption('--benchmarks'):
        pytest.skip("parts of the benchmark: make test ARGS='--benchmarks'")

    def run(name: str, *options: str) -> Path:
        path = tmp_path_factory.mktemp('benchmark') / 'benchmark.json'
        program = [sys.executable, str(PROGRAMS / f'{name}.py'), '--quick', *options]
        done = subprocess.run(
            [*program, '--output', str(path)],
            check=False,
            capture_output=True,
            text=True,
            timeout=LONGEST_RUN,
        )
        assert done.returncode == 0, done.stderr
        return path

    return run
