# SPDX-License-Identifier: Apache-2.0
"""What the steering says about itself."""

from __future__ import annotations

import math

from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.soliton_steering.steered_chain import SteeredChain


def report(chain: SteeredChain | None, silent: bool, moving: bool, begun: int) -> Report:
    """Report of a chain that may be `silent`, moving its soliton, with so many moves begun."""
    wall = None if chain is None or silent else chain.wall
    message = (
        'waiting for the topic chain'
        if chain is None
        else 'waiting for joint_states'
        if silent
        else 'no soliton'
        if wall is None
        else f'moving the soliton, at rotor {wall.place:.2f}'
        if moving
        else f'holding the soliton at rotor {wall.place:.2f}'
        if chain.steering.holding
        else 'ready'
    )
    values = {
        'rotor': math.nan if chain is None else chain.place,
        'phonon energy [J]': math.nan if chain is None else chain.phonon_energy,
        'moves begun': begun,
        'gentle speed [rotor spacings/s]': (
            math.nan if chain is None else chain.steering.gentle_speed
        ),
    }
    return Report(message, values, warning=wall is None)
