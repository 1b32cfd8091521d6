# SPDX-License-Identifier: Apache-2.0
"""The measurement of reactions runs, and its percentiles follow from the measured times."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NUDGES = 12


@pytest.fixture(scope='module')
def part(run_part: Callable[..., Path]) -> dict[str, Any]:
    return json.loads(run_part('react', '--rounds', '2', '--nudges', str(NUDGES)).read_text())[
        'react'
    ]


def test_every_nudge_is_followed_by_impulses_a_frame_and_a_state(
    part: dict[str, Any],
) -> None:
    rounds = part['details']['seconds']
    assert len(rounds) == 2
    for seconds in rounds:
        impulses, joints, states = (
            np.array(seconds[what]) for what in ('rotor_impulses', 'joint_states', 'soliton_state')
        )
        assert len(impulses) == len(joints) == len(states) == NUDGES
        assert (impulses > 0).all()
        assert (joints > impulses).all()
        assert (states > joints).all()


def test_the_figures_are_percentiles_of_each_round(part: dict[str, Any]) -> None:
    figures = {figure['what']: figure for figure in part['figures']}
    for what in ('rotor_impulses', 'joint_states', 'soliton_state'):
        for share in (50, 99):
            expected = [
                np.percentile(seconds[what], share) for seconds in part['details']['seconds']
            ]
            assert figures[f'nudge to {what}, p{share}']['values'] == pytest.approx(expected)
    assert figures['nudge to joint_states, p99']['goal'] == '3 ms at most'
