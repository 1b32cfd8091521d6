# SPDX-License-Identifier: Apache-2.0
"""Move walls to goals in simulated chains; measure position errors and excited phonons."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.linear.normal_modes import phonon_energy
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.steering.steering import MoveResult, Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation
from soliton_linkage_studies.drawing import LEGEND_ABOVE
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.palette import COLOURS, GREY
from soliton_linkage_studies.program import run_parallel, study_command
from soliton_linkage_studies.settings import Section, load_settings, setting
from soliton_linkage_studies.sweep.table import markdown_table

MoveKey = tuple[str, str]
"""Name of a chain and name of a condition."""

_TOLERANCE = 1e-8
"""Largest integration error of an angle per time unit [rad], far below the encoder noise."""
_OBSERVATION_TIME = 0.2
"""Time from the first frame to the goal command [s], during which the wall is at rest."""
_TIME_LIMIT = 120.0
"""Time limit of a simulation [s]. If the controller has not reported the end of the move by then,
the outcome is `Outcome.NOT_HELD`, as for a wall that does not settle at its goal."""
_SAMPLE_EVERY = 20
"""Number of simulated frames per frame of a `MoveRun` [1]."""
DISORDERED = ('spacing', 'rotor_length', 'mass', 'stiffness', 'rest_length')
_DRAWS = 100
"""Largest number of random chains that are tried to find one that a wall can pass [1]."""


@dataclass(frozen=True)
class Condition:
    """Encoder noise, damping and disorder of a chain."""

    noise: float = setting('standard deviation of a measured angle', 'rad', 0.0, 1.0)
    decay: float = setting('damping of a rotor / its moment of inertia', '1/s', 0.0, 1e6)
    disorder: float = setting('relative deviation of lengths, masses, stiffnesses', '1', 0.0, 0.3)


@dataclass(frozen=True)
class MoveTask:
    """Parameters of one simulated move."""

    chain: Chain
    condition: Condition
    start: float
    """Initial position of the wall [rotor spacings]."""
    goal: float
    """Target position of the wall [rotor spacings]."""
    seed: int
    frame_rate: float
    """Frames per second [Hz]."""
    held: float
    """Time after the arrival during which the position error is observed [s]."""
    torque_limit: float
    """Largest torque of an actuator [N m]."""

    def __call__(self) -> MoveRun:
        """Simulate the move. The torques that are computed from a frame act one frame later."""
        orbit = UniformOrbit(self.chain)
        chain, start = _started(self, orbit)
        simulation = ElasticSimulation(
            chain, start, period=1 / self.frame_rate, tolerance=_TOLERANCE
        )
        steering = Steering(orbit, TorqueAllocation(orbit, torque_limit=self.torque_limit))
        random = np.random.default_rng(self.seed)
        samples: list[tuple[float, float, float, float]] = []
        ended: MoveResult | None = None
        arc, arrival, peak = math.nan, math.nan, 0.0
        begin = round(_OBSERVATION_TIME * self.frame_rate)
        torques = np.zeros(chain.number_of_rotors)
        for frame in range(round(_TIME_LIMIT * self.frame_rate)):
            noise = self.condition.noise * random.standard_normal(len(torques))
            ended = steering.observe(simulation.time, simulation.angles + noise) or ended
            if frame == begin:
                ended = steering.move(self.goal)
                arc = fit_anywhere(orbit, simulation.angles).arc
            since = (frame - begin) / self.frame_rate
            if ended is not None and math.isnan(arrival):
                arrival = since
            if frame >= begin and (frame - begin) % _SAMPLE_EVERY == 0:
                arc = fit_near(orbit, simulation.angles, arc).arc
                left = phonon_energy(chain, simulation.angles, simulation.rates)
                trajectory = steering.trajectory
                point = orbit.site(trajectory.at(simulation.time).arc) if trajectory else math.nan
                samples.append((since, orbit.site(arc), point, left))
            if since > arrival + self.held:
                break
            simulation.hold(torques)
            torques = steering.torques()
            simulation.advance()
            peak = max(peak, float(chain.kinetic_energy(simulation.rates)))
        times, positions, references, energies = np.array(samples).T
        outcome = Outcome.NOT_HELD if ended is None else ended.outcome
        error = math.nan
        if outcome is Outcome.REACHED:
            error = float(np.abs(positions[times >= arrival] - self.goal).max())
        left = float(energies[-1])
        return MoveRun(outcome, arrival, times, positions, references, energies, error, left, peak)


@dataclass(frozen=True)
class MoveRun:
    """Result of a move; the arrays contain every twentieth frame."""

    outcome: Outcome
    duration: float
    """Time from the goal command to the first result that the controller reports [s]; NaN if it
    reports none within the time limit. In a successful move, this is the arrival."""
    times: Array
    """Time since the goal command [s], shape (T,)."""
    positions: Array
    """Wall position [rotor spacings], shape (T,)."""
    references: Array
    """Reference position of the wall [rotor spacings], shape (T,); NaN without a trajectory."""
    phonon_energies: Array
    """Energy of the phonons [J], shape (T,)."""
    error: float
    """Largest distance from the goal after the arrival [rotor spacings]; NaN unless `outcome` is
    `Outcome.REACHED`."""
    energy_left: float
    """Energy of the phonons at the end [J]."""
    peak_energy: float
    """Largest kinetic energy during the move [J]."""


def _started(task: MoveTask, orbit: UniformOrbit) -> tuple[Chain, Array]:
    """Return the chain of a task with its damping and disorder, and the initial angles [rad]."""
    damping = task.condition.decay * task.chain.moment_of_inertia
    chain = replace(task.chain, damping=damping)
    leg = task.seed % orbit.number_of_legs
    wall = orbit.configuration(orbit.arc_at(task.start, leg))
    if not task.condition.disorder:
        return chain, wall
    share = task.condition.disorder
    for draw in range(_DRAWS):
        seed, shares = _DRAWS * task.seed + draw, dict.fromkeys(DISORDERED, share)
        drawn = drawn_deviations(chain.number_of_rotors, seed, periodic=False, **shares)
        disordered = replace(chain, deviations=drawn)
        if blocked_bonds(disordered).any():
            continue
        try:
            return disordered, unstretched(disordered, wall)
        except ValueError:
            continue
    raise ValueError(
        f'a wall at {task.start:.2f} rotor spacings cannot pass through a '
        f'{task.chain.motion.value} chain with disorder {task.condition.disorder:g}, in any of '
        f'{_DRAWS} draws; lower the disorder'
    )


_KEYS = ('seed', 'frame_rate', 'moves', 'held', 'torque_limit', 'conditions', 'chains')


def read_moves(settings: Section, quick: bool) -> dict[MoveKey, list[MoveTask]]:
    """Read the tasks of a study. Raises ValueError for invalid settings."""
    settings.check_keys(*_KEYS)
    seed = settings.whole_number('seed', 0, 2**31)
    frame_rate = settings.number('frame_rate', 10.0, 2000.0)
    moves = settings.whole_number('moves', 1, 10_000)
    held, limit = settings.number('held', 0.0, 60.0), settings.number('torque_limit', 1e-9, 1e6)
    found = settings.sections('conditions')
    conditions = {name: Condition(**each.values_of(Condition)) for name, each in found.items()}
    tasks = {}
    for number, (name, chain) in enumerate(settings.chains().items()):
        random, last = np.random.default_rng([seed, number]), chain.number_of_rotors - 1
        positions = random.uniform(0, last, (moves, 2))[: 2 if quick else moves]
        for title, condition in conditions.items():
            tasks[name, title] = [
                MoveTask(chain, condition, start, goal, seed + move, frame_rate, held, limit)
                for move, (start, goal) in enumerate(positions.tolist())
            ]
    return tasks


def numbered_tasks(
    tasks: Mapping[MoveKey, Sequence[MoveTask]],
) -> dict[tuple[MoveKey, int], MoveTask]:
    """Return all tasks in one mapping; each key is a `MoveKey` and the number of the move."""
    return {(key, number): task for key, each in tasks.items() for number, task in enumerate(each)}


def runs_by_key(numbered: Mapping[tuple[MoveKey, int], MoveRun]) -> dict[MoveKey, list[MoveRun]]:
    """Group runs by chain and condition; `numbered` has the same keys as `numbered_tasks`."""
    runs: dict[MoveKey, list[MoveRun]] = {}
    for (key, _), run in numbered.items():
        runs.setdefault(key, []).append(run)
    return runs


_TITLES = (
    *('chain', 'condition', 'reached', 'largest error [spacings]', 'phonons at the end [J]'),
    *('phonons / peak energy of the wall', 'time [s]'),
)
_WORST = ('error', 'energy_left')


def move_table(runs: Mapping[MoveKey, Sequence[MoveRun]]) -> str:
    """Return the results as a Markdown table, one row per chain and condition."""
    rows = []
    for (name, title), moves in runs.items():
        reached = [run for run in moves if run.outcome is Outcome.REACHED]
        cells = [name, title, f'{len(reached)} of {len(moves)}', '', '', '', '']
        if reached:
            error, left = (max(getattr(run, key) for run in reached) for key in _WORST)
            share = max(run.energy_left / run.peak_energy for run in reached)
            durations = [run.duration for run in reached]
            times = f'{min(durations):.1f} to {max(durations):.1f}'
            cells[3:] = [f'{error:.4f}', f'{left:.1e}', f'{share:.1e}', times]
        rows.append(cells)
    return markdown_table(_TITLES, rows)


_CAPTION = """
Walls that move to goals in simulated chains. Each column is a chain, each colour a condition and
each line a move. (a) Position of the wall. (b) Absolute distance from the goal, at least
{least:g}. The dashed grey line marks {required:g} rotor spacings, the required holding accuracy.
(c) Phonon energy, divided by the peak energy of the wall during a move. Phonon energy is all
energy outside the motion of the wall. If two conditions give equal results, only the line of the
last condition is visible.
"""
_QUANTITIES = (
    'position [rotor spacings]',
    'distance from the goal [rotor spacings]',
    'phonons / peak energy of the wall [1]',
)
_REQUIRED_ACCURACY = 0.1
"""Required holding accuracy: largest allowed distance from the goal [rotor spacings]."""
_LEAST_ERROR = 1e-6
"""Smaller distances from the goal are drawn at this value [rotor spacings]."""
_LEAST_SHARE = 1e-16
"""Smaller ratios of phonon energy to peak kinetic energy are rounding errors, and are drawn at
this value [1]."""


def draw_moves(
    tasks: Mapping[MoveKey, Sequence[MoveTask]], runs: Mapping[MoveKey, Sequence[MoveRun]]
) -> FigureReport:
    """Draw position, distance from the goal and phonon energy over time, one column per chain."""
    chains = list(dict.fromkeys(name for name, _ in tasks))
    conditions = list(dict.fromkeys(title for _, title in tasks))
    figure = Figure(figsize=(max(4.3 * len(chains), 6), 10), layout='constrained')
    report = FigureReport(figure, _CAPTION.format(least=_LEAST_ERROR, required=_REQUIRED_ACCURACY))
    panels = figure.subplots(3, len(chains), sharex='col', sharey='row', squeeze=False)
    for column, name in zip(panels.T, chains, strict=True):
        for number, title in enumerate(conditions):
            colour = COLOURS[number % len(COLOURS)]
            for task, run in zip(tasks[name, title], runs[name, title], strict=True):
                distance = np.maximum(np.abs(run.positions - task.goal), _LEAST_ERROR)
                share = np.maximum(run.phonon_energies / run.peak_energy, _LEAST_SHARE)
                drawn = zip(column, _QUANTITIES, (run.positions, distance, share), strict=True)
                for axes, quantity, values in drawn:
                    axes.plot(run.times, values, color=colour, linewidth=0.9, alpha=0.8)
                    where, names = (
                        (f'{name}, {title}', f'to {task.goal:.3f}'),
                        ('time [s]', quantity),
                    )
                    report.add_points(*where, names, run.times, values)
        column[0].set(title=name)
        column[1].axhline(_REQUIRED_ACCURACY, color=GREY, linestyle='--', linewidth=0.8)
        column[2].set(xlabel='time since the goal command [s]')
    panels[0, 0].set(ylabel='a  position [rotor spacings]')
    panels[1, 0].set(ylabel='b  |position − goal| [rotor spacings]', yscale='log')
    panels[2, 0].set(ylabel='c  phonons / peak energy of the wall [1]', yscale='log')
    label = f'required: {_REQUIRED_ACCURACY:g}'
    panels[1, 0].plot([], [], '--', color=GREY, linewidth=0.8, label=label)
    for number, title in enumerate(conditions):
        panels[0, 0].plot([], [], color=COLOURS[number % len(COLOURS)], label=title)
    report.figure.legend(loc=LEGEND_ABOVE, ncols=len(conditions) + 1)
    return report


def _run(options: argparse.Namespace) -> str:
    tasks = read_moves(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    runs = runs_by_key(run_parallel('moves', numbered_tasks(tasks), options.workers))
    table = move_table(runs)
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    draw_moves(tasks, runs).save(options.output, 'moves')
    return f'{table}\ntable and picture are in {options.output}'


main = study_command(_run, 'no files were written', 'moves', __doc__, 'fewer moves')
