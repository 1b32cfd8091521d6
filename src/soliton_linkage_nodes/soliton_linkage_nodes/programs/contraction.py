# SPDX-License-Identifier: Apache-2.0
"""Measure with the analyser how moving walls contract (Lorentz contraction), at a dozen speeds.

For each speed, the program runs a simulator with noisy encoders, starts a wall by a nudge, and
records a bag. It then compares the measured speeds and widths of the walls with theory.
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
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames, read_chain
from soliton_linkage_nodes.programs.command_line import add_output, exit_on_failure
from soliton_linkage_nodes.runtime.child_processes import (
    START_LIMIT,
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
"""Frame rate of a recording [Hz]. During 6 s, 1500 frames of a wall are recorded."""
_SECONDS = 6.0
"""Duration of a recording after the nudge [s]."""
_WAY = 0.8
"""Duration of a recording divided by the duration of the same motion in the study without nodes,
`ContractionStudy.duration` [1]. Each duration is in units of sqrt(M / k_e) of its own chain, with
the mass M and the stiffness k_e. The two chains differ only in k_e. The recording is shorter, but
still contains the passage of the wall through the middle, where speed and width are measured."""
_POLL_INTERVAL = 0.1
"""Poll interval while waiting for the end of the program nudge [s]."""
_UNLIMITED = 1e6
"""Value of speed_limit of the actuator [rad/s] and of impulse_limit of the simulator [N m s], far
above all values of the study."""


def record(
    study: ContractionStudy, walls: int, kick: int, folder: Path, stopping: threading.Event
) -> Path:
    """Record a bag with one moving wall and return its path; RuntimeError if a node fails.

    The chain is `study.walls[walls].chain` with another stiffness k_e, which sets the time scale
    sqrt(M / k_e) of the motion. k_e is chosen so that the wall passes the middle of the chain
    during a recording of 6 s. The speed of the nudge along the zero mode is
    `study.walls[walls].kicks[kick]` times (a / r) sqrt(k_e / M) [rad/s], with the rotor spacing a,
    rotor length r and mass M.
    """
    chain, speed = study.walls[walls].chain, study.walls[walls].kicks[kick]
    unit = _SECONDS / (_WAY * study.duration(walls, kick))
    chain = replace(chain, stiffness=chain.mass / unit**2)
    name = folder / f'{study.walls[walls].name}_{kick}'
    shutil.rmtree(f'{name}_0', ignore_errors=True)
    simulated = {
        **{f'chain.{field}': getattr(chain, field) for field in described_fields(Chain)},
        'publish_rate': _RATE,
        'initial_state': 'right_leaning',
        'sensors.noise': study.noise,
        'sensors.seed': study.seed + 100 * walls + kick,
        'impulse_limit': _UNLIMITED,
        'subscribers': 2,
    }
    nudge = repr(speed * chain.spacing / (chain.rotor_length * chain.time_unit))
    options = [nudge, '--subscribers=2', f'--timeout={START_LIMIT}']
    processes, environment = ChildProcesses(folder / 'log'), dict(os.environ)
    try:
        processes.start('bag_recorder', ['-p', f'output:={name}'], environment)
        processes.start('edge_actuator', ['-p', f'speed_limit:={_UNLIMITED}'], environment)
        given = [each for key, value in simulated.items() for each in ('-p', f'{key}:={value}')]
        processes.start('simulator', given, environment)
        processes.start('nudge', [], environment, options)
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
    """Measure the speed and width of the wall in a bag; ValueError if the bag has no wall."""
    with open_bag(bag) as reader:
        found = [each for each in analyse_frames(reader) if each[1] is not None]
        chain = read_chain(reader).chain
    times = 1e-9 * np.array([joints.stamp - found[0][0].stamp for joints, _ in found])
    try:
        return passage_of(chain, times, [analysis.solitons for _, analysis in found if analysis])
    except ValueError as error:
        raise ValueError(f'bag {str(bag)!r}: {error}') from error


def main(arguments: Sequence[str] | None = None) -> None:
    """Record bags, measure and draw; exit with 1 after a failure, 130 after Ctrl-C."""
    parser = PlainParser(prog='contraction', description=__doc__)
    settings = 'settings file (config/studies/accuracy.yaml of the suite)'
    default = installed_settings('accuracy')
    parser.add_argument('config', type=Path, nargs='?', default=default, help=settings)
    add_output(parser, 'out/contraction', 'folder for the bags, the table and the picture')
    parser.add_argument('--quick', action='store_true', help='only every fourth soliton')
    options = parser.parse(arguments)
    stopping = stop_on_signals()
    with exit_on_failure('contraction'):
        section = load_settings(options.config).section('contraction')
        study = read_contraction_study(section, options.quick)
        options.output.mkdir(parents=True, exist_ok=True)
        try:
            with private_domain():
                passages = _measured(study, options.output, stopping)
        except KeyboardInterrupt:
            print('\ncontraction: stopped; the bags so far are kept', file=sys.stderr)
            raise
        with interruptible(stopping):
            at_rest = [rest_width(walls.chain) for walls in study.walls]
            study.write([*passages, *at_rest], options.output, RECORDED)
    print(f'bags, {RECORDED}.md and {RECORDED}.png are in {options.output}')


def _measured(
    study: ContractionStudy, folder: Path, stopping: threading.Event
) -> list[ContractedWall]:
    """Record and measure each wall.

    A wall whose recording fails is recorded once more, because a busy machine may cause the
    failure.
    """

    def measured(number: int, kick: int) -> ContractedWall:
        bag = record(study, number, kick, folder, stopping)
        with interruptible(stopping):
            return measure(bag)

    walls = enumerate(study.walls)
    runs = [(number, each, kick) for number, each in walls for kick in range(len(each.kicks))]
    progress = ProgressLine('contraction', len(runs))
    passages: list[ContractedWall] = []
    for number, each, kick in runs:
        which = f'{each.name}, kick {each.kicks[kick]:g}'
        progress.show(len(passages), which)
        try:
            passages.append(measured(number, kick))
        except (RuntimeError, ValueError) as error:
            print(f'\ncontraction: recording {which} again, because: {error}', file=sys.stderr)
            passages.append(measured(number, kick))
    progress.end(f'{len(runs)} solitons recorded and measured')
    return passages
