# SPDX-License-Identifier: Apache-2.0
"""The measurement of the identification runs, and continues after a stop."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path


def test_every_class_is_near_its_bound_and_chains_are_kept(run_part: Callable[..., Path]) -> None:
    output = run_part('identification')
    kept = sorted((output.parent / 'identification_draws').iterdir())
    assert len(kept) == 6
    figures = json.loads(output.read_text())['identification']['figures']
    measured = {each['what']: each['values'][0] for each in figures}
    for name in ('flipper', 'wobbler', 'spinner'):
        assert 0.7 < measured[f'{name}: error / bound'] < 1.3
        assert measured[f'{name}: position error / bound'] < 1.3
