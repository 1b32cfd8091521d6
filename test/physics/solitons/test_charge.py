# SPDX-License-Identifier: Apache-2.0
"""Charges of configurations; those of the walls of the continuum stand beside these."""

from __future__ import annotations

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, chain_of
from linkage_motion import wall_between

from soliton_linkage.linkage.chain import Motion
from soliton_linkage.solitons.charge import charge_of_field, half_turns, topological_charge


@pytest.mark.parametrize('example', EXAMPLES)
def test_uniform_states_have_no_charge_and_exact_walls_have_charge_1(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, 40)
    for lean in (-1, 1):
        assert topological_charge(chain, chain.uniform_state(lean)) == 0
    for turned in (False, True):
        wall = wall_between(chain, 19, turned)
        assert topological_charge(chain, wall) == 1
        if chain.motion is Motion.SPINNER:
            assert abs(half_turns(chain, wall)) == 1
            assert half_turns(chain, chain.uniform_state(1)) == 0


def test_what_has_no_charge_is_refused() -> None:
    chain = chain_of(FLIPPER, 3)
    with pytest.raises(ValueError, match=r'lean = 0\.0 m must be a finite'):
        charge_of_field([0, 1], 0.0)
    with pytest.raises(ValueError, match='a flipper does not turn'):
        half_turns(chain, np.zeros(3))
    with pytest.raises(ValueError, match=r'angles of shape \(4,\)'):
        topological_charge(chain, np.zeros(4))
