# SPDX-License-Identifier: Apache-2.0
"""What a simulator says about itself: its pace, its energy and what holds it up."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.passage import Obstacle
from soliton_linkage_nodes.messages.chain_source import chain_in_words
from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.runtime.pacing import PacedLoop
from soliton_linkage_nodes.simulator.control import SimulationControl, SimulationStatus
from soliton_linkage_nodes.simulator.parameters import SimulatorParameters

_FRAMES_OVERDUE = 3
"""Frames that a report may miss before it says that the next takes long: one may lie on each
side of the second, and one may be late."""


class SimulationReport:
    """Reports on a simulation; rates are those since the report before."""

    def __init__(
        self,
        control: SimulationControl,
        loop: PacedLoop,
        publish_rate: float,
        complain: Callable[[str], object],
    ) -> None:
        """`complain` is called once with what stops the simulation until a reset."""
        self._control = control
        self._loop = loop
        self._publish_rate = publish_rate
        self._complain = complain
        self._said: str | None = None
        self._before = (time.monotonic(), 0, 0)

    def __call__(self, world: Mapping[str, Any]) -> Report:
        """Report of this moment, with figures of the world beside those of the motion."""
        status, punctuality = self._control.status, self._loop.punctuality
        now = time.monotonic()
        before, frames_before, missed_before = self._before
        self._before = (now, status.frames, punctuality.missed)
        rate = (status.frames - frames_before) / (now - before)
        late = 0 if status.paused else punctuality.missed - missed_before
        overdue = (now - before) * min(self._loop.rate, self._publish_rate) > _FRAMES_OVERDUE
        slow = not status.paused and not rate and overdue
        return Report(
            self._message(status, late, slow),
            {
                'publish rate [Hz]': rate,
                'real-time factor': rate / self._publish_rate,
                'frames': status.frames,
                'missed deadlines': punctuality.missed,
                'largest lateness [s]': punctuality.largest_lateness,
                'lag [s]': punctuality.lag,
                'energy [J]': status.energy,
                'dissipated [J]': status.dissipated,
                'energy drift': status.energy_drift,
                **world,
            },
            warning=bool(status.failure or late or slow),
        )

    def _message(self, status: SimulationStatus, late: int, slow: bool) -> str:
        message = f'{late} deadlines missed in the last second' if late else 'on time'
        if slow:
            message = 'the next frame takes long to compute'
        if status.paused:
            message = f'paused, {status.failure}' if status.failure else 'paused'
        if status.failure and status.failure != self._said:
            self._complain(message)
        self._said = status.failure
        return message


def simulation_in_words(chain: Chain, settings: SimulatorParameters) -> str:
    """What is being simulated, how, and at which rate."""
    elastic = settings.mechanics == 'elastic'
    how = f'elastic by {settings.integrator}' if elastic else settings.mechanics
    return f'simulating {chain_in_words(chain)}, {how}, at {settings.publish_rate:g} Hz'


def obstacles_in_words(obstacles: Sequence[Obstacle]) -> str:
    """Warning of bonds that may stop a wall."""
    first = obstacles[0]
    return (
        f'{len(obstacles)} bonds may stop a wall, first bond {first.bond} between rotors '
        f'{first.bond} and {first.bond + 1}: its spring of {first.rest_length:.6g} m '
        f'{first.reason}; lower the deviations of the chain'
    )
