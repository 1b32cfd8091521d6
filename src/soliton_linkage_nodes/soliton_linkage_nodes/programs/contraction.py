# SPDX-License-Identifier: Apache-2.0
"""Lorentz contraction measured by the analyser alone, from bags of walls at a dozen speeds.

Each wall is nudged into a simulated chain with noisy encoders and recorded by the nodes; the
bags are then analysed, and speeds and widths drawn and set beside theory.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.read.reading import open_bag
from soliton_linkage_nodes.programs.bag_analysis import analysed, read_chain
from soliton_linkage_nodes.programs.command_line import plain_failures
from soliton_linkage_nodes.runtime.child_processes import (
    LONGEST_START,
    ChildProcesses,
    private_domain,
)
from soliton_linkage_nodes.runtime.process import interruptible, stop_on_signals
from soliton_linkage_studies.accuracy.contraction import (
    RECORDED,
    ContractedWall,
    ContractionStudy,
    passage_of,
    read_contraction_study,
    rest_width,
)
from soliton_linkage_studies.program import installed_settings
from soliton_linkage_studies.settings import load_settings

_RATE = 250.0
"""Frames of a recording [Hz], some 1500 of a wall."""
_SECONDS = 6.0
"""How long a wall is recorded [s]."""
_WAY = 0.8
"""Part of the study's time for a wall that the recording takes: it ends before the far edge."""
_POLL_INTERVAL = 0.1
"""How soon it stops where it is told to [s]."""
_UNLIMITED = 1e6
"""Limit of kicks [rad/s] and impulses [N m s] for walls faster than a real actuator makes."""


def record(
    study: ContractionStudy, walls: int, kick: int, folder: Path, stopping: threading.Event
) -> Path:
    """Record a wall, chain and kick by number, in a bag; return its path.

    The chain's unit of time is such that the wall is past the middle after six seconds. Raises
    RuntimeError where a node fails.
    """
    chain, speed = study.walls[walls].chain, study.walls[walls].kicks[kick]
    unit = _SECONDS / (_WAY * study.duration(walls, kick))
    chain = replace(chain, stiffness=chain.mass / unit**2)
    name = folder / f'{study.walls[walls].name}_{kick}'
    shutil.rmtree(f'{name}_0', ignore_errors=True)
    processes = ChildProcesses(folder / 'log')
    environment = dict(os.environ)
    try:
        processes.start('bag_recorder', ['-p', f'output:={name}'], environment)
        processes.start('edge_actuator', _given(speed_limit=_UNLIMITED), environment)
        simulated = {
            **{f'chain.{field}': getattr(chain, field) for field in described_fields(Chain)},
            'publish_rate': _RATE,
            'initial_state': 'right_leaning',
            'sensors.noise': study.noise,
            'sensors.seed': study.seed + 100 * walls + kick,
            'impulse_limit': _UNLIMITED,
            'subscribers': 2,
        }
        processes.start('simulator', _given(**simulated), environment)
        nudge = speed * chain.spacing / (chain.rotor_length * chain.time_unit)
        processes.start(
            'nudge',
            [],
            environment,
            [repr(nudge), '--subscribers=2', f'--timeout={LONGEST_START}'],
        )
        while not processes.wait('nudge', _POLL_INTERVAL):
            if stopping.is_set():
                raise KeyboardInterrupt
        if stopping.wait(_SECONDS):
            raise KeyboardInterrupt
        processes.check()
    finally:
        processes.stop(['simulator'])
        processes.stop()
    return Path(f'{name}_0')


def measure(bag: Path) -> ContractedWall:
    """Speed and width of the wall of a bag; raises ValueError where it does not show one."""
    with open_bag(bag) as reader:
        found = [each for each in analysed(reader) if each[1] is not None]
        chain = read_chain(reader).chain
    times = 1e-9 * np.array([joints.stamp - found[0][0].stamp for joints, _ in found])
    try:
        return passage_of(chain, times, [analysis.solitons for _, analysis in found if analysis])
    except ValueError as error:
        raise ValueError(f'bag {str(bag)!r}: {error}') from error


def measured(
    study: ContractionStudy, folder: Path, stopping: threading.Event
) -> list[ContractedWall]:
    """Record and measure all walls of a study."""
    runs = [
        (walls, kick)
        for walls in range(len(study.walls))
        for kick in range(len(study.walls[walls].kicks))
    ]
    progress, passages = ProgressLine('contraction', len(runs)), []
    for number, (walls, kick) in enumerate(runs):
        each = study.walls[walls]
        progress.show(number, f'{each.name}, kick {each.kicks[kick]:g}')
        passages.append(_passage(study, walls, kick, folder, stopping))
    progress.end(f'{len(runs)} walls recorded and measured')
    return passages


def _passage(
    study: ContractionStudy, walls: int, kick: int, folder: Path, stopping: threading.Event
) -> ContractedWall:
    """Record and measure a wall, once more where that fails, as it may on a busy machine."""

    def attempt() -> ContractedWall:
        bag = record(study, walls, kick, folder, stopping)
        with interruptible(stopping):
            return measure(bag)

    try:
        return attempt()
    except (RuntimeError, ValueError) as error:
        wall = study.walls[walls]
        which = f'{wall.name}, kick {wall.kicks[kick]:g}'
        print(f'\ncontraction: {which}, is recorded once more, for {error}', file=sys.stderr)
    return attempt()


def main(arguments: Sequence[str] | None = None) -> None:
    """Record, measure and draw; exit with 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse(arguments)
    stopping = stop_on_signals()
    with plain_failures('contraction'):
        settings = load_settings(options.config).section('contraction')
        study = read_contraction_study(settings, options.quick)
        options.output.mkdir(parents=True, exist_ok=True)
        try:
            with private_domain():
                passages = measured(study, options.output, stopping)
        except KeyboardInterrupt:
            print('\ncontraction: stopped; the bags so far are kept', file=sys.stderr)
            raise
        with interruptible(stopping):
            at_rest = [rest_width(walls.chain) for walls in study.walls]
            study.write([*passages, *at_rest], options.output, RECORDED)
    print(f'bags, {RECORDED}.md and {RECORDED}.png are in {options.output}')


def _given(**parameters: object) -> list[str]:
    """ROS arguments that give parameters; a number stays of its kind."""
    given = []
    for name, value in parameters.items():
        given += ['-p', f'{name}:={value!r}' if isinstance(value, float) else f'{name}:={value}']
    return given


def _parser() -> PlainParser:
    parser = PlainParser(prog='contraction', description=__doc__)
    parser.add_argument(
        'config',
        type=Path,
        nargs='?',
        default=installed_settings('accuracy'),
        help='settings, as config/studies/accuracy.yaml [those that came with the suite]',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out/contraction'),
        help='folder for the bags, the table and the picture (%(default)s)',
    )
    parser.add_argument('--quick', action='store_true', help='every fourth wall, to try it out')
    return parser
