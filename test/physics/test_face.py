# SPDX-License-Identifier: Apache-2.0
"""The face of the package: its public names, and what a first script costs."""

from __future__ import annotations

import doctest
import subprocess
import sys

import soliton_linkage


def test_every_public_name_is_there_and_documented() -> None:
    for name in soliton_linkage.__all__:
        assert getattr(soliton_linkage, name).__doc__, name
    assert set(soliton_linkage.__all__) <= set(dir(soliton_linkage))


def test_the_first_script_runs() -> None:
    results = doctest.testmod(soliton_linkage)
    assert results.attempted > 0
    assert results.failed == 0


def test_what_is_not_asked_for_is_not_imported() -> None:
    command = 'import sys, soliton_linkage; soliton_linkage.Chain(); print(*sys.modules)'
    done = subprocess.run(
        [sys.executable, '-c', command], capture_output=True, text=True, check=True
    )
    assert not {'numba', 'matplotlib', 'soliton_linkage.estimation'} & set(done.stdout.split())
