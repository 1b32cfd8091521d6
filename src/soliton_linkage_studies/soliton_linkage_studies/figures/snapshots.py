# SPDX-License-Identifier: Apache-2.0
"""Snapshots of a wall that is reflected at both edges of its chain (paper, Figs. 2 and 3)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import mode_towards_last, zero_mode
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage.solitons.tanh_fit import order_field
from soliton_linkage.solitons.track import find_crossings, follow
from soliton_linkage_studies import drawing
from soliton_linkage_studies.experiments import record_kick
from soliton_linkage_studies.figure_report import FigureReport, chain_formula
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.settings import Section

_CAPTION = f"""
A wall in a chain of springs is reflected at both ends (paper, Figs. 2 and 3). Chain: {{chain}}.
The kick along the zero mode has the speed v₀ = {{kick:g}} a√(kₑ/M). (a) Before the kick. (b) Wall
halfway through its first crossing. (c) After one round trip, with the wall at the last rotor
again.{{lowered}}

{drawing.LINKAGE} Dashed red lines are springs. In each state {drawing.MODE}. {drawing.PROJECTIONS}
"""
_LOWERED = (
    ' Odd rotors (grey) are shifted down so that rotors do not overlap; therefore the springs '
    'look longer than their true length.'
)
_APART = 1.6
"""Downward shift of odd rotors if they would overlap even ones [rotor lengths]."""
_WIDTH = 9.0
"""Width of the figure [inches]."""


@FIGURES.add('figure_2')
@FIGURES.add('figure_3')
def snapshot_figure(section: Section, quick: bool) -> FigureReport:
    """Draw a chain before its kick, with its wall halfway, and after a round trip of the wall."""
    section.check_keys('chain', 'kick', 'duration', 'frames')
    chain = section.chain()
    kick = section.number('kick', 0.0, 100.0)
    duration = section.number('duration', 0.0, 1e6)
    frames = section.whole_number('frames', 10, 100_000)
    recording = record_kick(chain, kick, duration, frames // 2 if quick else frames)
    track = follow(chain, recording)
    crossings = find_crossings(chain, track)
    if len(crossings) < 2:
        found = f'found {len(crossings)} of 2 crossings'
        raise section.error('duration', f'is too short: {found}; increase it')
    first, second = crossings[:2]
    back = recording.times >= second.end
    back &= recording.times <= 2 * second.end - second.start
    fields, _ = order_field(chain, recording.angles)
    halfway = int(np.searchsorted(track.times, (first.start + first.end) / 2))
    chosen = [0, halfway, int(np.argmax(np.where(back, fields.mean(axis=1), -math.inf)))]
    lowered = _APART * chain.rotor_length if chain.rotor_length > chain.spacing else 0.0
    shift = _LOWERED if lowered else ''
    caption = _CAPTION.format(chain=drawing.description(chain), kick=kick, lowered=shift)
    report = FigureReport(Figure(layout='constrained'), caption)
    panels = report.figure.subplots(3, 1)
    states = ('before the kick', 'wall halfway to the first rotor', 'after one round trip')
    shown = [(angles, zero_mode(chain, angles)) for angles in recording.angles[chosen]]
    pictures = [
        drawing.ChainPicture(axes, chain, *each, projections=True, lowered=lowered)
        for axes, each in zip(panels, shown, strict=True)
    ]
    width, height = drawing.expand_limits(pictures)
    report.figure.set_size_inches(_WIDTH, 3 * (_WIDTH * height / width + 0.4) + 0.3)
    drawing.add_legend(report.figure)
    for axes, frame, letter, state in zip(panels, chosen, 'abc', states, strict=True):
        angles = recording.angles[frame]
        time = recording.times[frame] / chain.time_unit
        axes.set_title(rf'{letter}  {state}, $t = {time:.0f}\,\sqrt{{M/k_e}}$', loc='left')
        report.add_points(letter, state, ('rotor n', 'phi [rad]'), np.arange(len(angles)), angles)
    _compare(report, chain, recording, kick, crossings[0].site_rate)
    return report


def _compare(
    report: FigureReport, chain: Chain, recording: Recording, kick: float, speed: float
) -> None:
    trips, turns = _cycle(chain)
    counts = ('two', 2.0), ('none', 0.0)
    if chain.motion is Motion.SPINNER:
        counts = ('one', 1.0), ('edge rotors by 2π; all by π per passage', 1.0)
    for quantity, (paper, expected), theory, found in (
        ('round trips of the wall', counts[0], 'half the reflections of rigid bars', trips),
        ('turns of each rotor', counts[1], 'rigid bars', turns),
    ):
        name = f'{quantity} in a cycle, {chain.motion.value}'
        report.add_comparison(name, paper, f'{theory} in a cycle', found, expected)
    way = site_arc(chain)
    slow = kick * chain.spacing / (way * chain.rotor_length)
    report.add_comparison(
        f'speed of the wall after a kick of {kick:g}, rotors / √(M/kₑ), {chain.motion.value}',
        'not given',
        chain_formula('v₀ a / (Λ r)', slow, chain, 'slow limit', **{'v₀': kick, 'Λ': way}),
        speed * chain.time_unit,
    )
    energies = chain.elastic_energy(recording.angles) + chain.kinetic_energy(recording.rates)
    kept, name = float(energies[-1] / energies[0]), 'final energy / initial energy'
    report.add_comparison(f'{name}, {chain.motion.value}', '1', '1', kept, 1.0)


def _cycle(chain: Chain) -> tuple[float, float]:
    start = chain.uniform_state(-1)
    length = UniformOrbit(chain).length
    simulation = RigidSimulation(chain, start, zero_mode(chain, start), period=length / 400)
    cycle = simulation.record(length)
    ahead = [
        mode_towards_last(chain, angles) @ rates > 0
        for angles, rates in zip(cycle.angles, cycle.rates, strict=True)
    ]
    turns = np.round((cycle.angles[-1] - cycle.angles[0]) / (2 * math.pi))
    return np.count_nonzero(np.diff(ahead)) / 2, float(np.abs(turns).mean())
