# SPDX-License-Identifier: Apache-2.0
"""Report of a recorded experiment: trajectory of the soliton, numbers and pictures."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.track import Crossing, Track, find_crossings, measured_track
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.live_view.sharing import shared_page, soliton_numbers
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.state_conversions import solitons_from_msg
from soliton_linkage_nodes.programs.bag_analysis import read_recording
from soliton_linkage_nodes.programs.experiment.observer import soliton_sites
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_studies.pictures import save_run

_BEFORE_NUDGE = 0.5
"""The pictures begin at this time before the nudge or burst [s]."""


@dataclass(frozen=True)
class RecordedRun:
    """Data from the bag of one experiment. Times are relative to the nudge or burst [s]."""

    named: NamedChain
    recording: Recording
    track: Track
    solitons: tuple[list[float], ...]
    """One flat list for each time in `track.times`, with three numbers per soliton: position
    [rotor spacings], standard deviation of the position [m], and charge. The page view.html
    requires these different units."""
    crossings: tuple[Crossing, ...]
    states: Mapping[int, tuple[float, ...]]
    """Site coordinates [rotor spacings] of the solitons in each recorded soliton_state message.
    The keys are stamps [ns]."""
    events: tuple[str, ...]
    messages: int
    lost: int
    publish_rate: float
    """Rate of joint_states [Hz], computed from the arrival times after the nudge."""


def read_run(bag: Path) -> RecordedRun:
    """Read the bag of an experiment; ValueError if a topic of the experiment is missing."""
    with open_bag(bag) as reader:
        named, recording = read_recording(reader)
        received, frames = zip(*read_topic(reader, 'joint_states'), strict=True)
        commands = (
            *read_topic(reader, 'nudge'),
            *_if_recorded(reader, interfaces.EDGE_COMMAND.name),
        )
        states = [message for _, message in read_topic(reader, 'soliton_state')]
        events = [each for _, each in _if_recorded(reader, interfaces.SOLITON_EVENTS.name)]
        custom = reader.custom_data
        messages = reader.message_count
    first = time_from_msg(frames[0].header.stamp)
    nudged = ((commands[0][0] if commands else first) - first) * 1e-9
    times, walls = _walls(states, first, nudged)
    track = measured_track(named.chain, times, walls)
    return RecordedRun(
        named=named,
        recording=_since(recording, nudged),
        track=track,
        solitons=tuple(map(soliton_numbers, walls)),
        crossings=find_crossings(named.chain, track),
        states={
            stamp: soliton_sites(state)
            for state in states
            # Skip states that the recorder has received before the first frame.
            if (stamp := time_from_msg(state.header.stamp)) >= first
        },
        events=tuple(event.kind_name for event in events),
        messages=messages,
        lost=sum(json.loads(custom.get('lost_messages', '{}')).values()),
        publish_rate=_rate([stamp for stamp in received if stamp >= first + nudged * 1e9]),
    )


def largest_difference(
    live: Mapping[int, tuple[float, ...]], replayed: Mapping[int, tuple[float, ...]]
) -> float:
    """Return the largest difference between live and replayed site coordinates [rotor spacings].

    Live solitons were estimated during the experiment, replayed ones while the bag was played. The
    keys of `live` and `replayed` are stamps [ns]. The result is infinite if the number of
    solitons differs at a stamp.
    """
    largest = 0.0
    for stamp in live.keys() & replayed.keys():
        if len(live[stamp]) != len(replayed[stamp]):
            return math.inf
        distances = (abs(a - b) for a, b in zip(live[stamp], replayed[stamp], strict=True))
        largest = max([largest, *distances])
    return largest


def draw(run: RecordedRun, folder: Path) -> None:
    """Draw kymograph.png and track.png with their captions, and write view.html."""
    chain, recording, track = run.named.chain, run.recording, run.track
    save_run(chain, recording, track, run.crossings, folder)
    nearest = np.searchsorted(track.times, recording.times).clip(max=len(track.times) - 1)
    solitons = [run.solitons[state] for state in nearest]
    energies = {'elastic': chain.elastic_energy(recording.angles)}
    if len(recording.rates):
        energies['kinetic'] = chain.kinetic_energy(recording.rates)
    title = f'Experiment with a {chain.motion.value}'
    page = shared_page(title, chain, recording.times, recording.angles, solitons, energies)
    (folder / 'view.html').write_text(page, encoding='utf-8')


def summarise(run: RecordedRun) -> dict[str, Any]:
    """Return the numbers about the recorded run for summary.json."""
    walls = list(run.states.values()) or [()]
    speeds = [crossing.site_rate for crossing in run.crossings]
    return {
        'motion': run.named.chain.motion.value,
        'rotors': run.named.rotors,
        'crossings': len(run.crossings),
        'first_sites': walls[0],
        'last_sites': walls[-1],
        'speed_rotors_per_s': float(np.mean(speeds)) if speeds else None,
        'events': dict(Counter(run.events)),
        'recorded_messages': run.messages,
        'lost_messages': run.lost,
        'publish_rate_hz': run.publish_rate,
    }


def _if_recorded(reader: BagReader, name: str) -> list[tuple[int, Any]]:
    """Return receive times [ns] and messages of a topic that older bags may lack."""
    recorded = any(each.name.rpartition('/')[2] == name for each in reader.topics)
    return list(read_topic(reader, name)) if recorded else []


def _rate(received: list[int]) -> float:
    if len(received) < 2:
        return 0.0
    return (len(received) - 1) / ((received[-1] - received[0]) * 1e-9)


def _walls(
    states: list[SolitonState], first: int, nudged: float
) -> tuple[Array, list[tuple[AnalysedSoliton, ...]]]:
    """Return the times of soliton states relative to the nudge [s], and each state's solitons.

    States earlier than 0.5 s before the nudge are omitted. `first` is the stamp of the first frame
    [ns], and `nudged` is the time from this stamp to the nudge [s].
    """
    stamps = [time_from_msg(state.header.stamp) - first for state in states]
    times = np.array(stamps, dtype=np.float64) * 1e-9 - nudged
    kept = np.flatnonzero(times >= -_BEFORE_NUDGE)
    return times[kept], [solitons_from_msg(states[number]) for number in kept]


def _since(recording: Recording, nudged: float) -> Recording:
    times = recording.times - nudged
    kept = times >= -_BEFORE_NUDGE
    rates = recording.rates[kept] if len(recording.rates) else recording.rates
    return Recording(times[kept], recording.angles[kept], rates)
