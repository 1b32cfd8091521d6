# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a simulator: frame rate, energy and failures."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.passage import Obstacle
from soliton_linkage_nodes.messages.chain_source import describe_chain
from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.runtime.pacing import PacedLoop
from soliton_linkage_nodes.simulator.control import SimulationControl, SimulationStatus
from soliton_linkage_nodes.simulator.parameters import SimulatorParameters

_FRAMES_OVERDUE = 3
"""Largest number of missing frames per report without a warning [1]: one at each end of the
second, and one late frame."""


class SimulationReport:
    """Report of a simulation, with the rates since the previous report."""

    def __init__(
        self,
        control: SimulationControl,
        loop: PacedLoop,
        settings: SimulatorParameters,
        complain: Callable[[str], object],
    ) -> None:
        """Call `complain` once for each fault of the simulation."""
        self._control = control
        self._loop = loop
        self._publish_rate = settings.publish_rate
        self._drift_limit = settings.energy_drift_limit
        self._complain = complain
        self._logged = ''
        self._before = (time.monotonic(), 0, 0)

    def __call__(self, world: Mapping[str, Any]) -> Report:
        """Return the current report; `world` holds further values."""
        status, punctuality = self._control.status, self._loop.punctuality
        now = time.monotonic()
        before, frames_before, missed_before = self._before
        self._before = (now, status.frames, punctuality.missed)
        rate = (status.frames - frames_before) / (now - before)
        late = 0 if status.paused else punctuality.missed - missed_before
        overdue = (now - before) * min(self._loop.rate, self._publish_rate) > _FRAMES_OVERDUE
        slow = not status.paused and not rate and overdue
        message, fault = self._message(status, late, slow)
        if fault and fault != self._logged:
            self._complain(fault)
        self._logged = fault
        return Report(
            message,
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
            warning=bool(fault or late),
        )

    def _message(self, status: SimulationStatus, late: int, slow: bool) -> tuple[str, str]:
        """Return the state of the simulation, and the fault to log (empty: none)."""
        if status.failure:
            return (f'paused, {status.failure}',) * 2
        if slow:
            steps = self._control.simulation.steps_per_frame
            message = (
                f'the next frame takes long to compute, {steps:.1g} steps of the solver at least; '
                'use softer springs, heavier masses, less damping or slower rotors'
            )
            return message, message
        fault = ''
        if abs(status.energy_drift) > self._drift_limit:
            fault = (
                f'the energy drift of the solver exceeds energy_drift_limit = '
                f'{self._drift_limit:g}; use a smaller tolerance'
            )
        if status.paused:
            return 'paused', fault
        if late:
            return f'{late} deadlines missed in the last second', fault
        return fault or 'on time', fault


def describe_simulation(chain: Chain, settings: SimulatorParameters) -> str:
    """Return a description of the chain, the mechanics and the frame rate."""
    elastic = settings.mechanics == 'elastic'
    how = f'elastic, integrator {settings.integrator}' if elastic else settings.mechanics
    return f'simulating {describe_chain(chain)}, {how}, at {settings.publish_rate:g} Hz'


def describe_obstacles(obstacles: Sequence[Obstacle]) -> str:
    """Return a warning about bonds that may stop a soliton."""
    first = obstacles[0]
    return (
        f'{len(obstacles)} bonds may stop a wall, first bond {first.bond} between rotors '
        f'{first.bond} and {first.bond + 1}: its spring of {first.rest_length:.6g} m '
        f'{first.reason}; lower the deviations of the chain'
    )
