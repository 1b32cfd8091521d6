# SPDX-License-Identifier: Apache-2.0
"""What the steering says about itself."""

from __future__ import annotations

import math

from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.soliton_steering.move_server import MoveServer
from soliton_linkage_nodes.soliton_steering.steered_chain import SteeredChain


def report(chain: SteeredChain | None, silent: bool, server: MoveServer) -> Report:
    """Report of a chain that may be `silent`, and of the moves of its soliton."""
    goal, ended = server.goal, server.ended
    wall = None if chain is None or silent else chain.wall
    message = (
        'waiting for the topic chain'
        if chain is None
        else 'waiting for joint_states'
        if silent
        else 'no soliton'
        if wall is None
        else f'moving the soliton, at rotor {wall.place:.2f}'
        if goal is not None
        else f'holding the soliton at rotor {wall.place:.2f}'
        if chain.steering.holding
        else 'ready'
    )
    values = {
        'rotor': math.nan if chain is None else chain.place,
        'phonon energy [J]': math.nan if chain is None else chain.phonon_energy,
        'moves begun': server.begun,
        'move from rotor': math.nan if goal is None else server.start,
        'move to rotor': math.nan if goal is None else goal.request.rotor,
        'deviations left out': '' if chain is None else chain.limitation,
        'last move': '' if ended is None else f'{ended.outcome.value}: {ended.message}',
        'gentle speed [rotor spacings/s]': (
            math.nan if chain is None else chain.steering.gentle_speed
        ),
    }
    return Report(message, values, warning=wall is None)
