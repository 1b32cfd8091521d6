# SPDX-License-Identifier: Apache-2.0
"""The soft actuator: its step response, its parameters found again, and the work that it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from soliton_linkage.actuation.edge_drive import EdgeOrder, Kind
from soliton_linkage.actuation.pneumatic_fit import StepResponse, fit_step_response
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.torque_books import TorqueBooks
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.studies.drawing import BLACK, BLUE, GREY, RED
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_SEED = 1
_KILO = 1e3
_MILLI = 1e-3
_FRAMES_A_SECOND = 500
_TOLERANCE = 1e-12
_TIME = 'time [s]'


def actuator_figure(section: Section, quick: bool) -> Plate:
    """Pressure after a step, closed form beside small steps and a fit; work beside energy."""
    section.allow('chain', 'pressure', 'duration', 'ramp', 'noise', 'rate')
    actuator = PneumaticActuator()
    pressure = section.number('pressure', 1.0, actuator.highest_pressure)
    duration = section.number('duration', 0.01, 10.0)
    ramp = section.number('ramp', 0.0, 10.0)
    order = EdgeOrder(Edge.FIRST, Kind.PRESSURE, pressure, duration, ramp, ramp)
    plate = Plate(Figure(figsize=(8, 10), layout='constrained'))
    above, middle, below = plate.figure.subplots(3)
    draw_response(plate, above, actuator, order.profile)
    noise = section.number('noise', 0.0, 1e5)
    rate = section.number('rate', 10.0, 1e4)
    _draw_fit(plate, middle, actuator, (pressure, duration, noise, rate))
    _draw_work(plate, below, chain_from(section.section('chain')), actuator, order, quick)
    return plate


def draw_response(
    plate: Plate, axes: Axes, actuator: PneumaticActuator, command: Profile
) -> float:
    """Pressure under a command: closed form, and the equation solved by steps.

    Returns the largest distance of the one from the other [Pa].
    """
    times = np.linspace(0.0, command.end + 6 * actuator.venting_time, 400)
    asked = np.array([float(command.after(time)) for time in times])
    closed = np.array([actuator.driven(0.0, command, 0.0, time)[0] for time in times])

    def derivative(time: float, state: Array) -> Array:
        lag = float(command.after(time)) - state
        return np.where(lag > 0, lag / actuator.filling_time, lag / actuator.venting_time)

    shown = slice(None, None, 20)
    solution = solve_ivp(
        derivative, (0, times[-1]), [0.0], t_eval=times[shown], max_step=1e-3, rtol=1e-8
    )
    stepped = solution.y[0]
    axes.plot(times, asked / _KILO, '--', color=GREY, label='commanded')
    axes.plot(times, closed / _KILO, color=BLUE, label='closed form')
    axes.plot(times[shown], stepped / _KILO, 'o', color=BLACK, label='solved by steps')
    axes.set(xlabel=_TIME, ylabel='pressure [kPa]', title='a', ylim=(0, None))
    axes.legend()
    for series, x, y in (
        ('commanded', times, asked),
        ('closed form', times, closed),
        ('solved by steps', times[shown], stepped),
    ):
        plate.note('a', series, (_TIME, 'pressure [Pa]'), x, y)
    largest = int(np.argmax(stepped))
    plate.compare(
        'pressure of the soft actuator at its highest [Pa]',
        '',
        'closed form',
        float(stepped[largest]),
        float(closed[shown][largest]),
    )
    return float(np.abs(stepped - closed[shown]).max())


def _draw_fit(
    plate: Plate,
    axes: Axes,
    actuator: PneumaticActuator,
    record: tuple[float, float, float, float],
) -> None:
    """A noisy record of a step up and down, and what is found from it."""
    pressure, duration, noise, rate = record
    times = np.arange(0.0, 3 * duration, 1 / rate)
    commands = np.where((times >= duration / 4) & (times < 1.5 * duration), pressure, 0.0)
    exact = actuator.responses(0.0, times, commands)
    read = exact + noise * np.random.default_rng(_SEED).normal(size=len(times))
    fit = fit_step_response(StepResponse(times, commands, read))
    found = PneumaticActuator(filling_time=fit.filling_time, venting_time=fit.venting_time)
    fitted = found.responses(0.0, times, commands)
    axes.step(times, commands / _KILO, '--', color=GREY, where='post', label='commanded')
    axes.plot(times, read / _KILO, '.', color=BLACK, label='read')
    axes.plot(times, fitted / _KILO, color=RED, label='fitted')
    axes.set(xlabel=_TIME, ylabel='pressure [kPa]', title='b')
    axes.legend()
    for series, values in (('commanded', commands), ('read', read), ('fitted', fitted)):
        plate.note('b', series, (_TIME, 'pressure [Pa]'), times, values)
    for name in ('filling_time', 'venting_time'):
        plate.compare(
            f'{name.replace("_", " ")} from a noisy step response [s]',
            '',
            'as set',
            getattr(fit, name),
            getattr(actuator, name),
        )


def _draw_work(
    plate: Plate,
    axes: Axes,
    chain: Chain,
    actuator: PneumaticActuator,
    order: EdgeOrder,
    quick: bool,
) -> None:
    """Energy of a chain that the actuator drives, and the work booked from its frames."""
    period = (4 if quick else 1) / _FRAMES_A_SECOND
    driven = driven_chain(chain, actuator, order, period)
    for series, values, style, colour in (
        ('energy of the chain', driven.energies, '-', BLUE),
        ('work booked', driven.works, ':', BLACK),
    ):
        axes.plot(driven.times, values / _MILLI, style, color=colour, label=series)
        plate.note('c', series, (_TIME, 'energy [J]'), driven.times, values)
    axes.set(xlabel=_TIME, ylabel='energy [mJ]', title='c')
    axes.legend()
    plate.compare(
        'work of a pressure on the chain [J]',
        '',
        'energy gained',
        float(driven.works[-1]),
        float(driven.energies[-1]),
    )


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
    chain: Chain, actuator: PneumaticActuator, order: EdgeOrder, period: float
) -> DrivenChain:
    """Carry out an order at the first edge of the left-leaning chain, in frames of a period [s].

    Until the last torque is gone.
    """
    start = chain.uniform_state(-1)
    simulation = ElasticSimulation(chain, start, period=period, tolerance=_TOLERANCE)
    drive = TorqueDrive(chain, actuator, timeout=0.0)
    drive.edges.obey(order, Edge.FIRST, 0.0)
    books = TorqueBooks(chain.number_of_rotors)
    frames = [(0.0, 0.0, 0.0)]
    rest = simulation.energy
    while drive.active:
        time, angles = simulation.time, simulation.angles
        torques = drive.torques(angles, time, time + period).torques
        simulation.hold(torques)
        simulation.advance()
        books.add(torques, simulation.angles - angles, period)
        frames.append((simulation.time, simulation.energy - rest, books.account.work))
    return DrivenChain(*np.array(frames).T)
