# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.live_view.moves import Pull

CHAIN = Chain(number_of_rotors=4)
ROTOR, LIMIT = 2, 1e-3


def pulled(direction: float, angle: float, rate: float = 0.0) -> float:
    """Return the torque on a rotor whose pointer is in a direction from the pivot."""
    x = ROTOR * CHAIN.spacing + CHAIN.rotor_length * math.sin(direction)
    pull = Pull(ROTOR, x, CHAIN.rotor_length * math.cos(direction))
    angles = np.full(4, angle)
    return pull.torque(CHAIN, angles, np.full(4, rate), LIMIT)


@given(direction=st.floats(-3.0, 3.0), angle=st.floats(-50.0, 50.0), rate=st.floats(-1e3, 1e3))
def test_the_torque_is_bounded(direction, angle, rate):
    assert abs(pulled(direction, angle, rate)) <= LIMIT


def test_the_torque_turns_the_rotor_towards_the_pointer():
    for turns in [-3, 0, 2]:
        angle = 0.4 + math.tau * turns
        assert pulled(0.9, angle) > 0 > pulled(-0.1, angle)
        assert pulled(0.4, angle) == pytest.approx(0.0, abs=1e-12)


def test_the_torque_damps_the_rotor():
    assert pulled(0.4, 0.4, rate=5.0) < 0 < pulled(0.4, 0.4, rate=-5.0)


def test_a_pointer_at_the_pivot_has_no_direction():
    pull = Pull(ROTOR, ROTOR * CHAIN.spacing, 0.0)
    assert pull.torque(CHAIN, np.zeros(4), None, LIMIT) == 0.0


def test_a_pointer_without_a_position_is_rejected():
    for place in [(math.nan, 0.0), (0.0, math.inf)]:
        with pytest.raises(ValueError, match='of the pointer must be finite'):
            Pull(ROTOR, 0.0, 0.0).point_to(*place)
