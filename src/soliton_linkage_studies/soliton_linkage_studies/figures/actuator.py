# SPDX-License-Identifier: Apache-2.0
"""The soft actuator: its step response, its parameters found again, and the work that it does."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.actuators import (
    TIME,
    draw_response,
    driven_chain,
    stepped_response,
)
from soliton_linkage_studies.figures.registry import FIGURES
from soliton_linkage_studies.palette import BLACK, BLUE, GREY, RED
from soliton_linkage_studies.plates import Plate
from soliton_linkage_studies.pneumatic_fit import StepResponse, fit_step_response
from soliton_linkage_studies.settings import Section, chain_from

_CAPTION = """
The soft actuator, a chamber that fills and vents with a lag of its own. (a) Its pressure after a
command with ramps (dashed grey): in closed form (blue line) and solved by small steps (black
dots). (b) A noisy record of a step up and down (black dots: read; dashed grey: commanded), and
the response with the filling and venting times that are found from it (red line). (c) Energy of a
chain of springs that the actuator drives (blue line), and the work that is booked from torques
and angles of its frames (dotted black), which must be the same.
"""
_SEED = 1
"""Of the noise of the record."""
_FRAMES_A_SECOND = 500
"""In which an actuator drives a chain [Hz]; a quick figure takes a quarter of them."""


@FIGURES.add('soft_actuator')
def actuator_figure(section: Section, quick: bool) -> Plate:
    """Pressure after a step, closed form beside small steps and a fit; work beside energy."""
    section.allow('chain', 'pressure', 'duration', 'ramp', 'noise', 'rate')
    actuator = PneumaticActuator()
    pressure = section.number('pressure', 1.0, actuator.highest_pressure)
    duration = section.number('duration', 0.01, 10.0)
    ramp = section.number('ramp', 0.0, 10.0)
    order = EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, pressure, duration, ramp, ramp)
    plate = Plate(Figure(figsize=(8, 10), layout='constrained'), _CAPTION)
    above, middle, below = plate.figure.subplots(3)
    draw_response(plate, above, stepped_response(actuator, order.profile))
    noise = section.number('noise', 0.0, 1e5)
    rate = section.number('rate', 10.0, 1e4)
    _draw_fit(plate, middle, actuator, (pressure, duration, noise, rate))
    _draw_work(plate, below, chain_from(section.section('chain')), actuator, order, quick)
    return plate


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
    axes.step(times, commands / 1e3, '--', color=GREY, where='post', label='commanded')
    axes.plot(times, read / 1e3, '.', color=BLACK, label='read')
    axes.plot(times, fitted / 1e3, color=RED, label='fitted')
    axes.set(xlabel=TIME, ylabel='pressure [kPa]')
    axes.set_title('b  filling and venting times from a noisy record', loc='left')
    axes.legend()
    for series, values in (('commanded', commands), ('read', read), ('fitted', fitted)):
        plate.note('b', series, (TIME, 'pressure [Pa]'), times, values)
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
    order: EdgeCommand,
    quick: bool,
) -> None:
    """Energy of a chain that the actuator drives, and the work booked from its frames."""
    period = (4 if quick else 1) / _FRAMES_A_SECOND
    driven = driven_chain(chain, actuator, order, period)
    for series, values, style, colour in (
        ('energy of the chain', driven.energies, '-', BLUE),
        ('work booked', driven.works, ':', BLACK),
    ):
        axes.plot(driven.times, values * 1e3, style, color=colour, label=series)
        plate.note('c', series, (TIME, 'energy [J]'), driven.times, values)
    axes.set(xlabel=TIME, ylabel='energy [mJ]')
    axes.set_title('c  energy that the chain gains, and work that is booked', loc='left')
    axes.legend()
    plate.compare(
        'work of a pressure on the chain [J]',
        '',
        'energy gained',
        float(driven.works[-1]),
        float(driven.energies[-1]),
    )
