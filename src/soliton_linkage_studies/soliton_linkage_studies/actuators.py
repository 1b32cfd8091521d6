# SPDX-License-Identifier: Apache-2.0
"""Soft actuators at work: their pressure after a command, and chains that they drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.work import TorqueLedger
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.palette import BLACK, BLUE, GREY
from soliton_linkage_studies.plates import Plate

_TOLERANCE = 1e-12
"""Error of the angles in a time unit [rad]: work and energy are compared to 1e-9."""
TIME = 'time [s]'
"""Label of an axis."""
_STEPPED = slice(None, None, 20)
"""Instants at which the solution by steps is looked at."""


@dataclass(frozen=True)
class CommandResponse:
    """Pressure of an actuator under a command, by its closed form and by small steps."""

    times: Array
    """Instants [s], shape (T,)."""
    commanded: Array
    """Pressure that is asked for [Pa], shape (T,)."""
    closed: Array
    """Pressure in closed form [Pa], shape (T,)."""
    stepped: Array
    """The equation solved by steps [Pa], at every twentieth instant."""

    @property
    def distance(self) -> float:
        """Largest distance of the solution by steps from the closed form [Pa]."""
        return float(np.abs(self.stepped - self.closed[_STEPPED]).max())


def stepped_response(actuator: PneumaticActuator, command: Profile) -> CommandResponse:
    """Response to a command until the actuator is vented."""
    times = np.linspace(0.0, command.end + 6 * actuator.venting_time, 400)
    asked = np.array([float(command.after(time)) for time in times])
    closed = np.array([actuator.driven(0.0, command, 0.0, time)[0] for time in times])

    def derivative(time: float, state: Array) -> Array:
        lag = float(command.after(time)) - state
        return np.where(lag > 0, lag / actuator.filling_time, lag / actuator.venting_time)

    solution = solve_ivp(
        derivative, (0, times[-1]), [0.0], t_eval=times[_STEPPED], max_step=1e-3, rtol=1e-8
    )
    return CommandResponse(times, asked, closed, solution.y[0])


def draw_response(plate: Plate, axes: Axes, response: CommandResponse) -> Axes:
    """Pressure under a command: asked for, in closed form, and by steps."""
    series = (
        ('commanded', response.times, response.commanded, '--', GREY),
        ('closed form', response.times, response.closed, '-', BLUE),
        ('solved by steps', response.times[_STEPPED], response.stepped, 'o', BLACK),
    )
    for name, times, pressures, style, colour in series:
        axes.plot(times, 1e-3 * pressures, style, color=colour, label=name)
        plate.note('a', name, (TIME, 'pressure [Pa]'), times, pressures)
    axes.set(xlabel=TIME, ylabel='pressure [kPa]', ylim=(0, None))
    axes.set_title('a  pressure after a command', loc='left')
    axes.legend()
    largest = int(np.argmax(response.stepped))
    plate.compare(
        'pressure of the soft actuator at its highest [Pa]',
        '',
        'closed form',
        float(response.stepped[largest]),
        float(response.closed[_STEPPED][largest]),
    )
    return axes


@dataclass(frozen=True)
class DrivenChain:
    """What an actuator does to a chain of springs, in T frames."""

    times: Array
    """Instants of the frames [s], shape (T,)."""
    energies: Array
    """Energy that the chain has gained [J], shape (T,)."""
    works: Array
    """Work that is booked from torques and angles [J], shape (T,)."""


def driven_chain(
    chain: Chain, actuator: PneumaticActuator, order: EdgeCommand, period: float
) -> DrivenChain:
    """Carry out an order at the first edge of the left-leaning chain, in frames of a period [s].

    Until the last torque is gone.
    """
    start = chain.uniform_state(-1)
    simulation = ElasticSimulation(chain, start, period=period, tolerance=_TOLERANCE)
    drive = TorqueDrive(chain, actuator, timeout=0.0)
    drive.edges.command(order, Edge.FIRST, 0.0)
    ledger = TorqueLedger(chain.number_of_rotors)
    frames = [(0.0, 0.0, 0.0)]
    rest = simulation.energy
    while drive.active:
        time, angles = simulation.time, simulation.angles
        torques = drive.torques(angles, time, time + period).torques
        simulation.hold(torques)
        simulation.advance()
        ledger.add(torques, simulation.angles - angles, period)
        frames.append((simulation.time, simulation.energy - rest, ledger.totals.work))
    return DrivenChain(*np.array(frames).T)
