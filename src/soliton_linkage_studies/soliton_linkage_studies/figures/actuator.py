# SPDX-License-Identifier: Apache-2.0
"""Figure of the soft actuator: step response, fitted parameters, and work on a chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.profile import Profile
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.work import TorqueLedger
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import BLACK, BLUE, GREY, RED
from soliton_linkage_studies.pneumatic_fit import StepResponse, fit_step_response
from soliton_linkage_studies.settings import Section

_TOLERANCE = 1e-12
"""Largest integration error of an angle per time unit [rad]; work and energy agree to 1e-9."""
TIME = 'time [s]'
_STEPPED = slice(None, None, 20)
"""Slice of `CommandResponse.times` that gives the times of the numerical solution."""


@dataclass(frozen=True)
class CommandResponse:
    """Pressure response of an actuator, in closed form and by numerical integration."""

    times: Array
    """Times of the response [s], shape (T,)."""
    commanded: Array
    """Commanded pressure [Pa], shape (T,)."""
    closed: Array
    """Pressure in closed form [Pa], shape (T,)."""
    stepped: Array
    """Pressure by numerical integration [Pa], at the times `times[_STEPPED]`."""

    @property
    def distance(self) -> float:
        """Largest difference between the numerical solution and the closed form [Pa]."""
        return float(np.abs(self.stepped - self.closed[_STEPPED]).max())


def stepped_response(actuator: PneumaticActuator, command: Profile) -> CommandResponse:
    """Return the pressure response from the start of a command until the actuator has vented."""
    times = np.linspace(0.0, command.end + 6 * actuator.venting_time, 400)
    asked = np.array([float(command.after(time)) for time in times])
    closed = np.array([actuator.response(0.0, command, 0.0, time)[0] for time in times])

    def derivative(time: float, state: Array) -> Array:
        lag = float(command.after(time)) - state
        return np.where(lag > 0, lag / actuator.filling_time, lag / actuator.venting_time)

    solution = solve_ivp(
        derivative, (0, times[-1]), [0.0], t_eval=times[_STEPPED], max_step=1e-3, rtol=1e-8
    )
    return CommandResponse(times, asked, closed, solution.y[0])


def draw_response(report: FigureReport, axes: Axes, response: CommandResponse) -> None:
    """Draw three pressures: commanded, in closed form, and by numerical integration."""
    for name, times, pressures, style, colour in (
        ('commanded', response.times, response.commanded, '--', GREY),
        ('closed form', response.times, response.closed, '-', BLUE),
        ('numerical integration', response.times[_STEPPED], response.stepped, 'o', BLACK),
    ):
        axes.plot(times, 1e-3 * pressures, style, color=colour, label=name)
        report.add_points('a', name, (TIME, 'pressure [Pa]'), times, pressures)
    axes.set(xlabel=TIME, ylabel='pressure [kPa]', ylim=(0, None))
    axes.set_title('a  pressure after a command', loc='left')
    axes.legend()
    largest = int(np.argmax(response.stepped))
    both = float(response.stepped[largest]), float(response.closed[_STEPPED][largest])
    report.add_comparison('highest pressure of the soft actuator [Pa]', '', 'closed form', *both)


@dataclass(frozen=True)
class DrivenChain:
    """Energy of a chain and work of the actuator that drives it, in T frames."""

    times: Array
    """Times of the frames [s], shape (T,)."""
    energies: Array
    """Energy that the chain has gained since the first frame [J], shape (T,)."""
    works: Array
    """Work of the actuator since the first frame [J], shape (T,)."""


def driven_chain(
    chain: Chain, actuator: PneumaticActuator, order: EdgeCommand, period: float
) -> DrivenChain:
    """Simulate a command at the first edge of a left-leaning chain, with a frame `period` [s]."""
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


_CAPTION = """ The soft actuator is a pneumatic chamber that fills and vents with first-order lags.
(a) Pressure after a command with ramps (dashed grey): closed form (blue line) and numerical
integration (black dots). (b) Measured pressure of a noisy step up and down (black dots), the
command (dashed grey), and the response with the fitted filling and venting times (red line). (c)
Energy gained by a chain of springs that the actuator drives (blue line), and work computed from
the torques and angles of its frames (dotted black). The two curves must be equal.
"""


@FIGURES.add('soft_actuator')
def actuator_figure(section: Section, quick: bool) -> FigureReport:
    """Draw the pressure response, a fit of the time constants, and the work on a chain."""
    section.check_keys('chain', 'pressure', 'duration', 'ramp', 'noise', 'rate')
    actuator = PneumaticActuator()
    order = read_command(section)
    report = new_report(_CAPTION, 8, 10)
    above, middle, below = report.figure.subplots(3)
    draw_response(report, above, stepped_response(actuator, order.profile))
    _draw_fit(report, middle, actuator, order, section)
    period = (4 if quick else 1) / 500
    chain = section.chain()
    _draw_work(report, below, driven_chain(chain, actuator, order, period))
    return report


def read_command(section: Section) -> EdgeCommand:
    """Read a pressure command [Pa] for the first edge, with duration and ramp [s]."""
    pressure = section.number('pressure', 1.0, PneumaticActuator().highest_pressure)
    duration = section.number('duration', 0.01, 10.0)
    ramp = section.number('ramp', 0.0, 10.0)
    return EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, pressure, duration, ramp, ramp)


def _draw_fit(
    report: FigureReport,
    axes: Axes,
    actuator: PneumaticActuator,
    order: EdgeCommand,
    section: Section,
) -> None:
    noise, rate = section.number('noise', 0.0, 1e5), section.number('rate', 10.0, 1e4)
    pressure, duration = order.value, order.duration
    times = np.arange(0.0, 3 * duration, 1 / rate)
    commands = np.where((times >= duration / 4) & (times < 1.5 * duration), pressure, 0.0)
    exact = actuator.responses(0.0, times, commands)
    read = exact + noise * np.random.default_rng(1).normal(size=len(times))
    fit = fit_step_response(StepResponse(times, commands, read))
    found = PneumaticActuator(filling_time=fit.filling_time, venting_time=fit.venting_time)
    fitted = found.responses(0.0, times, commands)
    axes.step(times, commands / 1e3, '--', color=GREY, where='post', label='commanded')
    axes.plot(times, read / 1e3, '.', color=BLACK, label='read')
    axes.plot(times, fitted / 1e3, color=RED, label='fitted')
    axes.set(xlabel=TIME, ylabel='pressure [kPa]')
    axes.set_title('b  filling and venting times from a noisy record', loc='left')
    axes.legend()
    for series, values in (('commanded', commands), ('read', read), ('fitted', fitted)):
        report.add_points('b', series, (TIME, 'pressure [Pa]'), times, values)
    for name in ('filling_time', 'venting_time'):
        quantity = f'{name.replace("_", " ")} from a noisy step response [s]'
        report.add_comparison(quantity, '', 'as set', getattr(fit, name), getattr(actuator, name))


def _draw_work(report: FigureReport, axes: Axes, driven: DrivenChain) -> None:
    for series, values, style, colour in (
        ('energy of the chain', driven.energies, '-', BLUE),
        ('work of the torques', driven.works, ':', BLACK),
    ):
        axes.plot(driven.times, values * 1e3, style, color=colour, label=series)
        report.add_points('c', series, (TIME, 'energy [J]'), driven.times, values)
    axes.set(xlabel=TIME, ylabel='energy [mJ]')
    axes.set_title('c  energy gained by the chain, and work of the torques', loc='left')
    axes.legend()
    both = float(driven.works[-1]), float(driven.energies[-1])
    report.add_comparison('work of the actuator on the chain [J]', '', 'energy gained', *both)
