# SPDX-License-Identifier: Apache-2.0
"""Catalogue of recorded bags, and reading of the soliton trajectory from a bag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.bags import metadata
from soliton_linkage_nodes.bags.guards import load_json, parse_count
from soliton_linkage_nodes.bags.reading import decoder, open_bag
from soliton_linkage_nodes.messages.view_conversions import state_numbers
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

PLAYED = (
    interfaces.CHAIN.name,
    interfaces.JOINT_STATES.name,
    interfaces.SOLITON_STATE.name,
    interfaces.LAST_KICK.name,
)
"""Names of the topics that a replay publishes, without namespace. A replay publishes no commands,
because they could drive a real chain."""
_MOST_BAGS = 200
"""Largest number of listed bags [1]. Older bags are not listed."""
_TRACK_POINTS = 500
"""Smallest number of points to which a long trajectory is reduced [1], about one per pixel of the
time line. Only every n-th point is kept, so that up to twice as many points may remain."""


@dataclass(frozen=True)
class CataloguedBag:
    """Contents of a bag, read from the metadata file.

    The stamp of a message is its reception time since the epoch [ns], not the stamp in its header.
    Times count from the start of the bag [s], without the pauses of the recorder.
    """

    name: str
    path: Path
    start: int
    """Stamp of the first message [ns]."""
    end: int
    """Stamp of the last message [ns]."""
    gaps: tuple[tuple[int, int], ...]
    """Stamps of the start and the end of each pause of the recorder [ns]."""
    topics: dict[str, int]
    lost: int

    @property
    def duration(self) -> float:
        """Duration of the recording without the pauses of the recorder [s]."""
        return self.time_of(self.end)

    def time_of(self, stamp: int) -> float:
        """Convert a stamp [ns] to the time since the start of the bag without pauses [s]."""
        return (stamp - self.start - metadata.time_in_gaps(self.gaps, self.start, stamp)) / SECOND

    def stamp_of(self, time: float) -> int:
        """Return the stamp [ns] for which `time_of` returns `time` [s]."""
        stamp = self.start + round(time * SECOND)
        for first, last in sorted(self.gaps):
            if first < stamp:
                stamp += last - first
        return stamp

    @property
    def played(self) -> list[str]:
        """Full names of the topics in the bag that the page can show."""
        return [name for name in self.topics if name.rpartition('/')[2] in PLAYED]


@dataclass(frozen=True)
class BagTrack:
    """Trajectory of the soliton in a bag.

    It is read from every n-th soliton_state message. If the bag contains none, `points` is empty,
    and `stamps` and `times` are from the joint_states. All times count from the start of the bag,
    without the pauses of the recorder.
    """

    points: tuple[tuple[float, float | None], ...]
    """Reception time [s] and site coordinate of the soliton [rotor spacings] for each point. The
    site coordinate is None if the chain has no soliton at this time."""
    stamps: Array
    """Stamps in the headers of the messages that were read, since the epoch [s], shape (n,)."""
    times: Array
    """Reception times of these messages, since the start of the bag [s], shape (n,)."""

    def time_of(self, stamp: float) -> float:
        """Return the estimated reception time [s] of a message from the stamp in its header [s].

        The delay between stamp and reception varies during a recording. Therefore the delay of the
        message with the nearest stamp is added. The result is NaN if the track has no messages.
        """
        if not self.stamps.size:
            return math.nan
        nearest = int(np.argmin(np.abs(self.stamps - stamp)))
        return float(self.times[nearest] + stamp - self.stamps[nearest])


NO_TRACK = BagTrack((), np.zeros(0), np.zeros(0))
"""Track without messages."""


class BagCatalogue:
    """Catalogue of the bags in the configured folders, without their subfolders."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(folder.resolve() for folder in folders)

    def bags(self) -> list[CataloguedBag]:
        """Return at most 200 readable bags, the newest bag first."""
        found = [
            bag
            for folder in self.folders
            for file in sorted(folder.glob(f'*/{metadata.METADATA_FILE}'))
            if (bag := _catalogued(file.parent)) and bag.path.resolve().parent == folder
        ]
        found.sort(key=lambda bag: bag.start, reverse=True)
        return found[:_MOST_BAGS]

    def bag(self, name: str) -> CataloguedBag:
        """Return the bag with this name. Raises ValueError if no folder contains the bag."""
        for bag in self.bags():
            if bag.name == name:
                return bag
        folders = ', '.join(map(str, self.folders)) or 'none is set'
        raise ValueError(
            f'no folder of bag_folders ({folders}) contains the bag {name!r}; add the folder'
        )


def track_of(bag: CataloguedBag) -> BagTrack:
    """Read the soliton trajectory from a bag. Raises ValueError if the bag cannot be read."""
    with open_bag(bag.path) as reader:
        topics = {each.name.rpartition('/')[2]: each for each in reader.topics}
        states = topics.get(interfaces.SOLITON_STATE.name)
        analysed = states is not None and reader.counts[states] > 0
        read = states if analysed else topics.get(interfaces.JOINT_STATES.name)
        if read is None:
            return NO_TRACK
        decode, step = decoder(read), max(1, reader.counts[read] // _TRACK_POINTS)
        points, stamps, times = [], [], []
        for number, (_, received, serialized) in enumerate(reader.messages([read])):
            if number % step == 0:
                message = decode(serialized)
                stamps.append(time_from_msg(message.header.stamp) / SECOND)
                times.append(round(bag.time_of(received), 4))
                if analysed:
                    position = state_numbers(message)['rotor']
                    points.append(
                        (times[-1], None if math.isnan(position) else round(position, 2))
                    )
    return BagTrack(tuple(points), np.array(stamps), np.array(times))


def _catalogued(path: Path) -> CataloguedBag | None:
    information: Any = metadata.read_metadata(path)
    try:
        topics = {
            each['topic_metadata']['name']: int(each['message_count'])
            for each in information['topics_with_message_count']
        }
        custom = metadata.custom_data_in(information)
        losses = load_json(custom.get('lost_messages', '{}'))
        start = int(information['starting_time']['nanoseconds_since_epoch'])
        duration = int(information['duration']['nanoseconds'])
        return CataloguedBag(
            path.name,
            path,
            start,
            start + duration,
            tuple(metadata.gaps_in(custom)),
            topics,
            sum(map(parse_count, losses.values())),
        )
    except (TypeError, KeyError, ValueError, AttributeError):
        return None
