# SPDX-License-Identifier: Apache-2.0
"""The bags of the folders that were named: what each holds, and the track of its soliton."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.guards.texts import count_in, load_json
from soliton_linkage_nodes.bags.metadata import METADATA_FILE, read_metadata
from soliton_linkage_nodes.bags.read.reading import decoder, open_bag, read_messages
from soliton_linkage_nodes.messages.view_conversions import state_numbers
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

PLAYED = (
    interfaces.CHAIN.name,
    interfaces.JOINT_STATES.name,
    interfaces.SOLITON_STATE.name,
    interfaces.LAST_KICK.name,
)
"""Topics of a bag that are played: what is seen. Commands would drive, reports be of now."""
_MOST_BAGS = 200
"""That are listed, newest first."""
_TRACK_POINTS = 500
"""Of the soliton's track on the time line: a point a pixel of it."""


@dataclass(frozen=True)
class ShelvedBag:
    """What a bag says that it holds."""

    name: str
    """Of its folder."""
    path: Path
    start: int
    """When its first message was received [ns]."""
    duration: float
    """From the first message to the last [s]."""
    topics: dict[str, int]
    """How many messages of each topic."""
    lost: int
    """Messages that were published and are not in it."""

    @property
    def messages(self) -> int:
        """How many there are of all topics."""
        return sum(self.topics.values())

    @property
    def played(self) -> list[str]:
        """Full names of the topics that a page can show."""
        return [name for name in self.topics if name.rpartition('/')[2] in PLAYED]


@dataclass(frozen=True)
class BagTrack:
    """Where the soliton of a bag was."""

    points: tuple[tuple[float, float | None], ...]
    """Time from the start of the bag [s] and place [rotor spacings], None where there was none."""
    delay: float
    """From the stamp of joint_states to when they were received [s]."""


class BagShelf:
    """Bags that lie in some folders; no others are opened."""

    def __init__(self, folders: Sequence[Path]) -> None:
        """Look into these folders, not into those within."""
        self.folders = tuple(folder.resolve() for folder in folders)

    def bags(self) -> list[ShelvedBag]:
        """All that can be read, newest first."""
        found = []
        for folder in self.folders:
            for metadata in sorted(folder.glob(f'*/{METADATA_FILE}')):
                bag = _shelved(metadata.parent)
                if bag is not None and bag.path.resolve().parent == folder:
                    found.append(bag)
        found.sort(key=lambda bag: bag.start, reverse=True)
        return found[:_MOST_BAGS]

    def bag(self, name: str) -> ShelvedBag:
        """The bag of a name; ValueError where none of the folders has it."""
        for bag in self.bags():
            if bag.name == name:
                return bag
        folders = ', '.join(map(str, self.folders)) or 'none was named'
        raise ValueError(
            f'bag {name!r} is in none of the folders of bag_folders ({folders}); name its folder'
        )


def track_of(bag: ShelvedBag) -> BagTrack:
    """Read where the soliton of a bag was; ValueError where the bag cannot be read."""
    with open_bag(bag.path) as reader:
        by_kind = {c.topic.rpartition('/')[2]: c for c in reader.connections}
        delay = 0.0
        frames = by_kind.get(interfaces.JOINT_STATES.name)
        if frames is not None:
            for _, received, serialized in read_messages(reader, [frames]):
                delay = (
                    received - time_from_msg(decoder(frames)(serialized).header.stamp)
                ) / SECOND
                break
        states = by_kind.get(interfaces.SOLITON_STATE.name)
        if states is None:
            return BagTrack((), delay)
        decode, every = decoder(states), max(1, states.msgcount // _TRACK_POINTS)
        points = []
        for number, (_, received, serialized) in enumerate(read_messages(reader, [states])):
            if number % every == 0:
                place = state_numbers(decode(serialized))['rotor']
                at = round((received - bag.start) / SECOND, 4)
                points.append((at, None if math.isnan(place) else round(place, 2)))
    return BagTrack(tuple(points), delay)


def _shelved(path: Path) -> ShelvedBag | None:
    information: Any = read_metadata(path)
    try:
        topics = {
            each['topic_metadata']['name']: int(each['message_count'])
            for each in information['topics_with_message_count']
        }
        losses = load_json((information.get('custom_data') or {}).get('lost_messages', '{}'))
        return ShelvedBag(
            path.name,
            path,
            int(information['starting_time']['nanoseconds_since_epoch']),
            information['duration']['nanoseconds'] / SECOND,
            topics,
            sum(map(count_in, losses.values())),
        )
    except (TypeError, KeyError, ValueError, AttributeError):
        return None
