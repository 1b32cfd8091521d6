# SPDX-License-Identifier: Apache-2.0
"""Measure the angles of a chain in a film, and write them to a bag for analyse_bag.

The bag has the topics chain, joint_states and joint_state_deviations, which contains the standard
deviations of the angles. The stamp of a message is the time of its picture. With --overlay, the
program also writes a copy of the film with the detected markers and the solitons.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.command_line import PlainParser
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.progress import ProgressLine
from soliton_linkage.vision.overlay import draw_overlay
from soliton_linkage.vision.video import (
    TimedPicture,
    Video,
    capture_camera,
    read_video,
    write_video,
)
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.messages.camera_measurement import (
    CameraMeasurement,
    CameraParameters,
    CameraReading,
    angles_to_msg,
    describe_reading,
    deviations_to_msg,
    median_deviation,
    walls_on_overlay,
)
from soliton_linkage_nodes.messages.chain_source import chain_of_file, markers_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg, without_offsets
from soliton_linkage_nodes.messages.picture_conversions import read_camera
from soliton_linkage_nodes.programs.command_line import add_output, add_quantity, exit_on_failure
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import stop_on_signals
from soliton_linkage_nodes.runtime.serialization import serialize
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg
from soliton_linkage_nodes.start import INTERRUPTED

_OVERLAY_QUALITY = 23
"""Constant rate factor of the H.264 encoder [1], the default of x264."""


class FilmSummary(NamedTuple):
    """Summary of the angles measured in a film."""

    bag: Path
    pictures: int
    """Number of pictures in which rotors are visible."""
    shares: float
    """Mean fraction of the rotors that are visible in these pictures [1]."""
    deviation: float
    """Median of the estimated standard deviations of the angles [rad]."""
    last: str
    """Description of the last picture and of all problems in the film."""
    ended_by: str
    """Reason why the measurement ended before the end of the film, or ''."""


def film_to_bag(
    video: Video,
    named: NamedChain,
    measurement: CameraMeasurement,
    output: Path,
    overlay: Path | None = None,
    stopping: threading.Event | None = None,
) -> FilmSummary:
    """Measure the angles in a film and write them to a bag.

    If `overlay` is set, a copy of the film with the detected markers is written to this path. If
    the film is damaged or `stopping` is set, the bag contains the angles measured before that
    moment. Raises ValueError if no angles were measured.
    """
    bag = BagWriter(output)
    shares: list[float] = []
    medians: list[float] = []
    last, ended_by = 'the film has no pictures', ''
    failure: ValueError | None = None
    progress = ProgressLine('measuring', video.frames)

    def measured() -> Iterator[tuple[TimedPicture, CameraReading]]:
        nonlocal last, ended_by, failure
        start = round(video.start * SECOND)
        try:
            for count, taken in enumerate(video.pictures, start=1):
                if stopping is not None and stopping.is_set():
                    ended_by = 'a signal'
                    return
                shown = measurement.measure(start + round(taken.time * SECOND), taken.picture)
                last = describe_reading(measurement, shown)
                progress.show(count, f'{count} pictures, {last}')
                if shown.frame.seen:
                    if not shares:
                        chain = chain_to_msg(named, time_to_msg(shown.stamp))
                        _put(bag, interfaces.CHAIN, shown.stamp, chain)
                    deviations = deviations_to_msg(named, shown)
                    _put(bag, interfaces.JOINT_STATE_DEVIATIONS, shown.stamp, deviations)
                    _put(bag, interfaces.JOINT_STATES, shown.stamp, angles_to_msg(named, shown))
                    shares.append(shown.frame.seen / named.rotors)
                    medians.append(median_deviation(shown.frame))
                yield taken, shown
        except ValueError as error:
            failure, ended_by = error, str(error)

    try:
        if overlay is None:
            deque(measured(), maxlen=0)
        else:
            overlay.parent.mkdir(parents=True, exist_ok=True)
            write_video(overlay, _drawn(measured(), named), _OVERLAY_QUALITY)
    finally:
        progress.clear()
        bag.close({'ended_by': ended_by} if ended_by else {})
        bag.remove_if_empty()
    if not shares:
        raise failure or ValueError(f'no angle was measured: {last}')
    share, deviation = float(np.mean(shares)), float(np.median(medians))
    return FilmSummary(bag.path, len(shares), share, deviation, last, ended_by)


def _put(bag: BagWriter, topic: interfaces.Topic, stamp: int, message: Any) -> None:
    stored = bag.add_topic(f'/{topic.name}', type_name(topic.type), topic.qos)
    bag.write(stored, stamp, serialize(message))


def _drawn(
    measured: Iterable[tuple[TimedPicture, CameraReading]], named: NamedChain
) -> Iterator[TimedPicture]:
    analyser = Analyser(named.chain)
    for taken, seen in measured:
        walls = []
        if seen.frame.seen:
            frame = seen.frame
            angles = without_offsets(frame.angles, named.encoder_offsets)
            analysis = analyser.analyse(seen.stamp, angles, None, frame.deviations)
            walls = walls_on_overlay(analysis.solitons, named.chain.spacing) if analysis else []
        drawn = draw_overlay(taken.picture, seen.frame, named.joint_names, walls)
        yield TimedPicture(taken.time, drawn)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure a film until its end, or a camera until Ctrl-C; exit with 1 after a failure.

    If Ctrl-C interrupts the measurement of a film, the exit code is 130.
    """
    options = _parser().parse(arguments)
    live = options.camera is not None
    with exit_on_failure('film_encoders'):
        stopping = stop_on_signals()
        named = chain_of_file(options.chain)
        lens = read_camera(options.camera_info) if options.camera_info else None
        parameters = CameraParameters(options.row_time, options.exposure, not options.unmarked)
        measurement = CameraMeasurement(
            named, markers_of_file(options.markers or options.chain), parameters, lens
        )
        pictures = capture_camera(options.camera) if live else None
        film = Video(time.time(), 0, pictures) if pictures else read_video(options.film)
        result = film_to_bag(film, named, measurement, options.output, options.overlay, stopping)
        option = f' --chain {options.chain}' if named.encoder_offsets else ''
        print(
            f'{result.pictures} pictures, {result.shares:.1%} of the rotors visible, standard '
            f'deviation {1e3 * result.deviation:.2g} mrad; {result.last}\n'
            f'next: analyse_bag {result.bag}{option}',
            file=sys.stderr,
        )
        if stopping.is_set():
            sys.exit(0 if live else INTERRUPTED)
        if result.ended_by:
            raise ValueError(result.ended_by)


def _parser() -> PlainParser:
    parser = PlainParser(prog='film_encoders', description=__doc__)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument('film', type=Path, nargs='?', help='file of a film, such as film.mp4')
    camera = 'number of a camera; the program measures until Ctrl-C'
    source.add_argument('--camera', type=int, metavar='NUMBER', help=camera)
    files = {
        '--chain': 'parameter file with chain.* and markers.*, such as config/flipper.yaml',
        '--markers': 'parameter file for which the markers were printed, if --chain is another '
        'file, such as one of identify_chain',
        '--overlay': 'also write a film with the detected markers, such as out/overlay.mp4',
        '--camera-info': 'calibration by calibrate_camera',
    }
    for name, text in files.items():
        needed = name == '--chain'
        parser.add_argument(name, type=Path, required=needed, metavar='FILE', help=text)
    add_output(parser, 'out/film', 'path of the bag; _0 is appended')
    quantities = described_fields(CameraParameters)
    for option, name in (('--row-time', 'row_time'), ('--exposure', 'exposure')):
        add_quantity(parser, option, quantities[name], 0.0, metavar='SECONDS')
    unmarked = 'the rotors have no markers; they are dark on a light background and do not touch'
    parser.add_argument('--unmarked', action='store_true', help=unmarked)
    return parser
