# SPDX-License-Identifier: Apache-2.0
"""The node takes an actuator that is registered, with its fields as parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from bench import Bench
from graphs import Graph
from numpy.typing import ArrayLike

from soliton_linkage.actuation.actuators import ACTUATORS, PneumaticActuator
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import NamedChain

pytestmark = pytest.mark.usefixtures('often')


@dataclass(frozen=True)
class TwinBellows(PneumaticActuator):
    """Bellows in pairs."""

    bellows: int = quantity(2, 'number of bellows', '', 1, 9)

    def torque(self, pressure: ArrayLike) -> Array:
        return self.bellows * super().torque(pressure)


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ACTUATORS, 'twin_bellows', TwinBellows)


def test_the_actuator_that_is_chosen_gives_the_torques(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named, {'actuator': 'twin_bellows', 'bellows': 3})
    bench.tell_chain()
    rest = named.chain.uniform_state(-1)
    bench.joints(rest, stamp=0.0)
    bench.joints(rest, stamp=1.0)
    bench.carry_out(edge=EdgeCommand.FIRST, kind=EdgeCommand.PRESSURE, value=1e5)
    held = bench.drive([rest, rest], 10.0, 10.0, messages=2)[-1]
    strength = 3 * 1e5 * PneumaticActuator().torque_per_pressure
    expected = strength * edge_mode(named.chain, rest, Edge.FIRST)
    np.testing.assert_allclose(held, expected, rtol=1e-6)


def test_an_actuator_that_is_not_known_is_refused(graph: Graph) -> None:
    known = "parameter actuator = 'steam' must be one of 'pneumatic', 'twin_bellows'"
    with pytest.raises(ValueError, match=known):
        graph.start(EdgeActuator, {'actuator': 'steam'})
