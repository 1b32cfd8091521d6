# SPDX-License-Identifier: Apache-2.0
"""Analyse bags without any node: write tables of soliton states and events, and pictures.

Several bags are analysed in parallel. Each bag gets its own folder of results and a row in
bags.csv. If the command is interrupted, repeat it to analyse the remaining bags.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.command_line import PlainParser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.progress import ProgressLine
from soliton_linkage.solitons.track import find_crossings, measured_track
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.reading import find_topic, open_bag
from soliton_linkage_nodes.live_view.sharing import shared_page, soliton_numbers
from soliton_linkage_nodes.messages.chain_source import chain_of_file, differences
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain
from soliton_linkage_nodes.messages.frames import FrameReader
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.messages.state_conversions import (
    EVENT_COLUMNS,
    columns,
    event_rows,
    row,
)
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames, read_chain
from soliton_linkage_nodes.runtime.process import interrupt_on_signals
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_studies.pictures import save_run
from soliton_linkage_studies.sweep.table import fill_table
from soliton_linkage_studies.workers import process_count

_NO_CHAIN = 'specify the chain with --chain, or record the topic chain'
_STATES = 'soliton_state.csv'
COLUMNS = (
    *('number', 'bag', 'motion', 'frames', 'duration [s]', 'frames tracked'),
    *('frames with a soliton', 'largest speed [m/s]', 'mean noise [rad]', 'failure'),
)


@dataclass(frozen=True)
class BagBatch:
    """Bags that are analysed in parallel, each with one row in a table."""

    bags: tuple[tuple[str, Path], ...]
    folder: Path
    analyse: Callable[[Path, Path, NamedChain | None, float | None], int]
    """Function that analyses one bag and returns the number of its frames. Its arguments are the
    bag, the output folder, the chain (None: the chain in the bag) and the noise of the angles
    [rad] (None: unknown)."""
    chain: Path | None = None
    noise: float | None = None
    name: str = 'bags'
    columns: tuple[str, ...] = COLUMNS

    @property
    def rows(self) -> int:
        """Number of bags."""
        return len(self.bags)

    def described(self) -> dict[str, Any]:
        """Return the inputs that determine the contents of the table."""
        return {
            'bags': [str(bag) for _, bag in self.bags],
            'chain': str(self.chain) if self.chain else None,
            'noise': self.noise,
        }

    def cells(self, row: int) -> list[str]:
        """Analyse bag number `row`, write its results, and return its row of the table."""
        name, bag = self.bags[row]
        given = chain_of_file(self.chain) if self.chain else None
        try:
            # The progress lines of parallel processes would overwrite each other. Hide these
            # lines.
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                self.analyse(bag, self.folder / name, given, self.noise)
            with (self.folder / name / _STATES).open(encoding='utf-8', newline='') as file:
                measured, failure = summary(csv.DictReader(file)), ''
        except (ArithmeticError, OSError, ValueError) as error:
            measured, failure = [''] * (len(COLUMNS) - 3), ' '.join(str(error).split())
        return [str(row), str(bag), *measured, failure]


def summary(states: Iterable[dict[str, str]]) -> list[str]:
    """Return the cells of one bag in the columns `motion` to `mean noise [rad]` of bags.csv.

    `states` contains the rows of the bag's soliton_state.csv.
    """
    motions: Counter[str] = Counter()
    stamps: list[int] = []
    tracked = seen = 0
    fastest, noise = 0.0, 0.0
    for state in states:
        stamps.append(int(state['stamp [ns]']))
        motions[state['motion_name']] += 1
        tracked += int(state['status']) == SolitonState.TRACKING
        velocity = float(state['soliton_velocity [m/s]'])
        seen += int(state['solitons']) > 0
        fastest = fastest if math.isnan(velocity) else max(fastest, abs(velocity))
        noise += float(state['noise [rad]'])
    duration = (stamps[-1] - stamps[0]) / SECOND
    (motion, _), *_ = motions.most_common(1)
    means = (f'{fastest:.6g}', f'{noise / len(stamps):.6g}')
    return [motion, str(len(stamps)), f'{duration:.6g}', str(tracked), str(seen), *means]


def named_bags(paths: Sequence[Path]) -> tuple[tuple[str, Path], ...]:
    """Return a unique name and the path of each bag; ValueError if a bag is given twice."""
    bags = [path.resolve() for path in paths]
    twice = [str(bag) for bag, count in Counter(bags).items() if count > 1]
    if twice:
        raise ValueError(f'bag {twice[0]} is given twice; give each bag once')
    names = Counter(bag.name for bag in bags)
    common = Path(os.path.commonpath(bags))
    return tuple(
        (bag.name if names[bag.name] == 1 else '_'.join(bag.relative_to(common).parts), bag)
        for bag in bags
    )


def analyse_many(study: BagBatch, workers: int, scheduler: str | None = None) -> int:
    """Analyse the bags that lack a row in bags.csv; return the number of rows with a failure."""
    path, rows = fill_table(study, study.folder, workers, scheduler)
    failed = [each for each in rows if each['failure']]
    for each in failed:
        print(f'{each["bag"]}: {each["failure"]}', file=sys.stderr)
    print(f'{study.rows - len(failed)} of {study.rows} bags in {path}')
    return len(failed)


_MOST_DRAWN = 4000
"""Largest number of frames drawn in a picture [1]. More frames would not be visible, because a
picture is 1200 pixels wide."""


class PictureFrames:
    """Every n-th frame of a bag; n doubles whenever more than 4000 frames would be stored."""

    def __init__(self, named: NamedChain) -> None:
        self._reader = FrameReader(named.joint_names, named.encoder_offsets)
        self._every, self._count = 1, 0
        self._kept: list[tuple[int, Array, tuple[AnalysedSoliton, ...]]] = []

    def add(self, joints: JointStates, analysis: Analysis) -> None:
        """Store a frame and its solitons if the number of the frame is a multiple of n."""
        if self._count % self._every == 0:
            self._kept.append((joints.stamp, self._reader.read(joints).angles, analysis.solitons))
            if len(self._kept) > _MOST_DRAWN:
                self._kept = self._kept[::2]
                self._every *= 2
        self._count += 1

    def draw(self, chain: Chain, folder: Path, title: str | None) -> None:
        """Write kymograph.png and track.png with captions and, if `title` is set, view.html."""
        stamps, angles, walls = zip(*self._kept, strict=True)
        times = (np.array(stamps) - stamps[0]) * 1e-9
        track = measured_track(chain, times, walls)
        recording = Recording(times, np.array(angles), np.empty((0, chain.number_of_rotors)))
        save_run(chain, recording, track, find_crossings(chain, track), folder)
        if title is not None:
            solitons = [soliton_numbers(each) for each in walls]
            page = shared_page(title, chain, times, recording.angles, solitons)
            (folder / 'view.html').write_text(page, encoding='utf-8')


def analyse(
    bag: Path,
    folder: Path,
    given: NamedChain | None = None,
    noise: float | None = None,
    limits: BagLimits = DEFAULT_LIMITS,
    log_time: bool = False,
    missing_joints: bool = False,
    html: bool = False,
) -> int:
    """Write the states, events and pictures of a bag to a folder; return the number of frames.

    The chain `given` replaces the chain in the bag. `noise` is the standard deviation of the
    angles [rad], None if it is unknown. With `html`, view.html is also written. With `log_time`,
    the receive times replace the stamps. Raises ValueError if no frame can be analysed, if several
    frames have the stamp 0 and `log_time` is false, or if a joint of `given` has no angle in the
    bag and `missing_joints` is false.
    """
    frames = late = unstamped = 0
    analysed = JointStateAnalysis(noise)
    with open_bag(bag, limits) as reader:
        total = reader.counts[find_topic(reader, 'joint_states')]
        named = given or read_chain(reader, _NO_CHAIN)
        drawn = PictureFrames(named)
        progress = ProgressLine('analysing', total)
        folder.mkdir(parents=True, exist_ok=True)
        with (
            (folder / 'soliton_state.csv').open('w', newline='') as file,
            (folder / 'soliton_events.csv').open('w', newline='') as events_file,
        ):
            table, events = csv.writer(file), csv.writer(events_file)
            table.writerow(columns())
            events.writerow(EVENT_COLUMNS)
            for joints, analysis in analyse_frames(reader, given, analysed, log_time):
                unstamped += not joints.stamp
                if analysis is None:
                    late += 1
                    continue
                table.writerow(row(analysis, joints))
                events.writerows(event_rows(analysis, joints, named.chain.spacing))
                drawn.add(joints, analysis)
                frames += 1
                progress.show(frames, f'{frames} frames')
    if not frames:
        raise ValueError(f'bag {str(bag)!r} has no frame that could be analysed')
    if unstamped > 1:
        raise ValueError(
            f'bag {str(bag)!r}: {unstamped} of {frames + late} frames have the stamp 0; '
            'add --stamps log to use the receive times'
        )
    _report_absent(bag, analysed, given is not None and not missing_joints)
    drawn.draw(named.chain, folder, f'Bag {bag.name}' if html else None)
    progress.end(f'{frames} frames of {bag} analysed, {late} late frames skipped; see {folder}')
    return frames


def _report_absent(bag: Path, analysed: JointStateAnalysis, fatal: bool) -> None:
    absent = analysed.absent
    if not absent:
        return
    named = f'{absent[0]!r}' if len(absent) == 1 else f'{absent[0]!r} to {absent[-1]!r}'
    line = (
        f'bag {str(bag)!r} has no angle of {len(absent)} of the {len(analysed.joint_names)} '
        f'joints of the chain: {named}'
    )
    if fatal:
        raise ValueError(f'{line}; correct --chain, or add --missing-joints')
    print(f'analyse_bag: {line}', file=sys.stderr)


def check_override(
    bag: Path, given: NamedChain, override: bool, limits: BagLimits = DEFAULT_LIMITS
) -> None:
    """Raise ValueError if `given` differs from the chain in a bag and `override` is false."""
    with open_bag(bag, limits) as reader:
        try:
            own = read_chain(reader)
        except ValueError:
            return
    changed = differences(given, own)
    if changed and not override:
        raise ValueError(
            f'--chain differs from the chain of bag {str(bag)!r}: {changed}; '
            'omit --chain, or add --override to replace the chain of the bag'
        )
    if changed:
        print(f'analyse_bag: --chain replaces the chain of the bag: {changed}', file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> None:
    """Analyse bags; exit with 1 after a failure, 130 after Ctrl-C."""
    options = _parser().parse(arguments)
    with command_line.exit_on_failure('analyse_bag'):
        try:
            interrupt_on_signals()
            limits = command_line.fields_of(options, BagLimits)
            given = chain_of_file(options.chain) if options.chain else None
            if given is not None:
                for bag in options.bags:
                    check_override(bag, given, options.override, limits)
            if len(options.bags) == 1:
                _within(options)(options.bags[0], options.output, given, options.noise)
            else:
                chain, folder = options.chain and options.chain.resolve(), options.output.resolve()
                bags, within = named_bags(options.bags), _within(options)
                study = BagBatch(bags, folder, within, chain, options.noise)
                sys.exit(min(analyse_many(study, options.workers, options.scheduler), 1))
        except KeyboardInterrupt:
            print('\nanalyse_bag: stopped; the table contains the frames so far', file=sys.stderr)
            raise


def _within(options: argparse.Namespace) -> Callable[..., int]:
    return partial(
        analyse,
        limits=command_line.fields_of(options, BagLimits),
        log_time=options.stamps == 'log',
        missing_joints=options.missing_joints,
        html=options.html,
    )


def _parser() -> PlainParser:
    parser = PlainParser(prog='analyse_bag', description=__doc__)
    command_line.add_bags(parser)
    command_line.add_output(
        parser,
        'out/analysis',
        'folder for soliton_state.csv, soliton_events.csv, kymograph.png and track.png; for '
        'several bags, one folder for each bag and bags.csv',
    )
    html = 'also write view.html, one file that shows the run in a browser without a server'
    parser.add_argument('--html', action='store_true', help=html)
    chain = 'parameter file with chain.* in SI units, for a bag without the topic chain'
    parser.add_argument('--chain', type=Path, metavar='FILE', help=chain)
    parser.add_argument(
        '--override', action='store_true', help='replace the chain of the bag by --chain'
    )
    parser.add_argument(
        '--noise',
        type=_noise,
        help='standard deviation of the encoder noise [rad], above 0 and at most 1; '
        'estimated by default',
    )
    parser.add_argument(
        '--stamps',
        choices=('header', 'log'),
        default='header',
        help='source of the times: header, the stamps of the messages, or log, the receive times, '
        'for drivers that publish no stamps (%(default)s)',
    )
    missing = 'allow joints of --chain that have no angle in the bag'
    parser.add_argument('--missing-joints', action='store_true', help=missing)
    command_line.add_fields(parser, BagLimits(), 'BYTES')
    where = parser.add_mutually_exclusive_group()
    count = 'number of parallel processes for several bags (one for each core)'
    where.add_argument('--workers', type=process_count, default=os.cpu_count() or 1, help=count)
    where.add_argument('--scheduler', help='address of a Dask cluster that shares the files')
    return parser


def _noise(text: str) -> float:
    try:
        noise = float(text)
    except ValueError:
        noise = math.nan
    if not 0 < noise <= 1:
        raise argparse.ArgumentTypeError(
            f'noise {text.strip()} must be above 0 and at most 1 rad; omit --noise to estimate it'
        )
    return noise
