# SPDX-License-Identifier: Apache-2.0
"""Analyse a bag without any node: a table of what each frame shows, and pictures of the run."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from soliton_linkage.estimation.analyser import AnalysedSoliton, Analysis
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.progress import ProgressLine
from soliton_linkage.solitons.track import find_crossings, measured_track
from soliton_linkage.studies.pictures import save_run
from soliton_linkage_nodes.bags.read.reading import (
    find_topic,
    open_bag,
)
from soliton_linkage_nodes.messages.conversions import (
    JointStates,
    NamedChain,
)
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.messages.state_conversions import columns, row
from soliton_linkage_nodes.programs.bag_analysis import analysed
from soliton_linkage_nodes.programs.chain_file import chain_of_file
from soliton_linkage_nodes.programs.linkage_bags import read_chain
from soliton_linkage_nodes.runtime.process import interrupt_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_MOST_DRAWN = 4000
"""Frames that a picture shows at most, more than it has columns."""


class Drawn:
    """Frames for the pictures, evenly thinned out so that any bag fits into memory."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        """Begin without any; the names are those of the joints, rotor 0 first."""
        self._reader = FrameReader(joint_names)
        self._every, self._count = 1, 0
        self._kept: list[tuple[int, Array, tuple[AnalysedSoliton, ...]]] = []

    def add(self, joints: JointStates, analysis: Analysis) -> None:
        """Keep a frame if it is one of those to be drawn."""
        if self._count % self._every == 0:
            self._kept.append((joints.stamp, self._reader.read(joints).angles, analysis.solitons))
            if len(self._kept) > _MOST_DRAWN:
                self._kept = self._kept[::2]
                self._every *= 2
        self._count += 1

    def draw(self, chain: Chain, folder: Path) -> None:
        """Draw kymograph.png and track.png, with their captions beside them."""
        stamps, angles, walls = zip(*self._kept, strict=True)
        times = (np.array(stamps) - stamps[0]) * 1e-9
        track = measured_track(chain, times, walls)
        recording = Recording(times, np.array(angles), np.empty((0, chain.number_of_rotors)))
        save_run(chain, recording, track, find_crossings(chain, track), folder)


def analyse(bag: Path, folder: Path, given: NamedChain | None, noise: float | None) -> int:
    """Write soliton_state.csv, kymograph.png and track.png; return the number of frames."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = late = 0
    with open_bag(bag) as reader, (folder / 'soliton_state.csv').open('w', newline='') as file:
        total = find_topic(reader, 'joint_states').msgcount
        named = given or read_chain(reader)
        drawn = Drawn(named.joint_names)
        progress = ProgressLine('analysing', total)
        table = csv.writer(file)
        table.writerow(columns())
        for joints, analysis in analysed(reader, given, noise):
            if analysis is None:
                late += 1
                continue
            table.writerow(row(analysis, joints))
            drawn.add(joints, analysis)
            frames += 1
            progress.show(frames, f'{frames} frames')
    if not frames:
        raise ValueError(f'bag {str(bag)!r} has no frame that could be analysed')
    drawn.draw(named.chain, folder)
    progress.end(f'{frames} frames of {bag} analysed, {late} were late; see {folder}')
    return frames


def main(arguments: Sequence[str] | None = None) -> None:
    """Analyse a bag; exit with 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        interrupt_on_signals()
        given = chain_of_file(options.chain) if options.chain else None
        analyse(options.bag, options.output, given, options.noise)
    except (OSError, ValueError) as error:
        print(f'analyse_bag: {error}', file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print('\nanalyse_bag: stopped; the table holds the frames so far', file=sys.stderr)
        sys.exit(INTERRUPTED)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='analyse_bag', description=__doc__)
    parser.add_argument('bag', type=Path, help='directory of the bag, as bags/flipper_0')
    parser.add_argument('--output', type=Path, default=Path('out/analysis'), help='folder')
    parser.add_argument(
        '--chain', type=Path, help='parameter file with chain.* for a bag without the topic chain'
    )
    parser.add_argument(
        '--noise', type=float, help="standard deviation of the encoders' noise [rad] [estimated]"
    )
    return parser
