# SPDX-License-Identifier: Apache-2.0
"""Analyse a bag without any node: a table of what each frame shows, and pictures of the run."""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from soliton_linkage.estimation.analyser import Analysis
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.track import Track, find_crossings
from soliton_linkage.studies.pictures import draw_kymograph, draw_track
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage_nodes.bags.read.reading import (
    find_topic,
    open_bag,
    read_chain,
)
from soliton_linkage_nodes.messages.conversions import (
    FrameReader,
    NamedChain,
    check_names,
    default_joint_names,
)
from soliton_linkage_nodes.messages.joint_states import JointStates
from soliton_linkage_nodes.messages.state_conversions import columns, row
from soliton_linkage_nodes.programs.bag_analysis import analysed
from soliton_linkage_nodes.runtime.process import interrupt_on_signals

_MOST_DRAWN = 4000
_STOPPED = 130


def chain_of_file(path: Path) -> NamedChain:
    """Chain of a parameter file, by its chain.* and joints; raises ValueError for none."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        nodes = content.values()
        given = {key: value for node in nodes for key, value in node['ros__parameters'].items()}
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        raise ValueError(
            f'{path} is no parameter file ({error}); give one as config/flipper.yaml'
        ) from error
    known = described_fields(Chain)
    parameters = {
        key.removeprefix('chain.'): value for key, value in given.items() if key[:6] == 'chain.'
    }
    unknown = sorted(parameters.keys() - known)
    if unknown:
        raise ValueError(f'{path}: chain.{unknown[0]} is unknown; known: {", ".join(known)}')
    chain = Chain(**parameters)
    joints = tuple(given.get('joint_names', ())) or default_joint_names(chain.number_of_rotors)
    check_names(f'{path}: joint_names', joints)
    if len(joints) != chain.number_of_rotors:
        raise ValueError(
            f'{path}: joint_names has {len(joints)} names for {chain.number_of_rotors} rotors; '
            'name one joint a rotor'
        )
    return NamedChain(chain, joints)


class Drawn:
    """Frames for the pictures, evenly thinned out so that any bag fits into memory."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        """Begin without any; the names are those of the joints, rotor 0 first."""
        self._reader = FrameReader(joint_names)
        self._every, self._count = 1, 0
        self._kept: list[tuple[int, Array, float, float]] = []

    def add(self, joints: JointStates, analysis: Analysis) -> None:
        """Keep a frame if it is one of those to be drawn."""
        if self._count % self._every == 0:
            first = analysis.solitons[0] if analysis.solitons else None
            place = (first.rotor, first.velocity) if first else (math.nan, math.nan)
            self._kept.append((joints.stamp, self._reader.read(joints).angles, *place))
            if len(self._kept) > _MOST_DRAWN:
                self._kept = self._kept[::2]
                self._every *= 2
        self._count += 1

    def draw(self, chain: Chain, folder: Path) -> None:
        """Draw kymograph.png and track.png."""
        stamps, angles, rotors, velocities = zip(*self._kept, strict=True)
        times = (np.array(stamps) - stamps[0]) * 1e-9
        track = Track(times, np.array(rotors), np.array(velocities) / chain.spacing)
        recording = Recording(times, np.array(angles), np.empty((0, chain.number_of_rotors)))
        draw_kymograph(chain, recording, track, folder / 'kymograph.png')
        draw_track(chain, track, find_crossings(chain, track), folder / 'track.png')


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
        sys.exit(_STOPPED)


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
