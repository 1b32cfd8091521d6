# SPDX-License-Identifier: Apache-2.0
"""Loops say the same as the Python that they are."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / 'analyse_record.py'


def test_an_analyser_says_the_same_without_a_compiler() -> None:
    compiled, plain = (
        json.loads(
            subprocess.run(
                [sys.executable, str(SCRIPT)],
                env={**os.environ, 'NUMBA_DISABLE_JIT': disabled},
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        for disabled in ('0', '1')
    )
    assert (compiled['compiled'], plain['compiled']) == (True, False)
    # Sums are rounded alike but for products that are contracted into them, to 1e-16 of each;
    # over these frames the filters and the quotients of small sums make 2e-12 of that.
    for one, other in zip(compiled['said'], plain['said'], strict=True):
        for left, right in zip(one, other, strict=True):
            if isinstance(left, float):
                assert left == pytest.approx(right, rel=1e-10, abs=1e-12, nan_ok=True)
            else:
                assert left == right
