# SPDX-License-Identifier: Apache-2.0
"""Which part of a bag is played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage_nodes.bags.read.reading import find_topic
from soliton_linkage_nodes.runtime.stamps import SECOND


@dataclass(frozen=True)
class Excerpt:
    """From when to when a bag is played, and from when to when it was recorded [ns]."""

    start: int
    end: int
    origin: int
    last: int

    @property
    def duration(self) -> float:
        """Of the whole bag [s]."""
        return (self.last - self.origin) / SECOND

    def part(self, offset: int, duration: int, until: int) -> Excerpt:
        """Another part of the bag: from an offset on, for a duration or to a stamp [ns].

        As in rosbag2 the later end counts, with the message that is there; what is 0 or less is
        not given. Raises ValueError where nothing of the bag lies between.
        """
        start = self.origin + max(offset, 0)
        ends = [start + duration + 1] if duration > 0 else []
        ends += [until + 1] if until > 0 else []
        end = min(self.last, max(ends, default=self.last))
        if not start < end:
            raise ValueError(
                f'nothing is recorded from {start} to {end} ns; the bag reaches from '
                f'{self.origin} to {self.last} ns'
            )
        return replace(self, start=start, end=end)


def excerpt(reader: Reader, start_offset: float, playback_until: float) -> Excerpt:
    """The part between two times of a bag [s], 0 for its beginning and its end.

    Raises ValueError where there is nothing between.
    """
    empty = not reader.message_count
    origin, last = (0, 0) if empty else (reader.start_time, reader.end_time)
    start = origin + round(start_offset * SECOND)
    end = min(last, origin + round(playback_until * SECOND)) if playback_until else last
    if not (empty or start < end):
        raise ValueError(
            f'parameter start_offset of bag_player = {start_offset:g} must lie '
            f'before {(end - origin) / SECOND:g} s, where playing ends'
        )
    return Excerpt(start, end, origin, last)


def chosen(reader: Reader, names: Sequence[str]) -> list[Connection]:
    """Topics of some names, or, with none, all; raises ValueError where the bag lacks one."""
    if not names:
        return list(reader.connections)
    return list({c.topic: c for c in (find_topic(reader, name) for name in names)}.values())


def full_name(reader: Reader, name: str) -> str:
    """Full name of a topic, or '' where no topic of the bag ends in the name."""
    ends = (c.topic.rpartition('/')[2] for c in reader.connections)
    return find_topic(reader, name).topic if name in ends else ''
