# SPDX-License-Identifier: Apache-2.0
"""Cost of recording joint states, and of reading and analysing a recording.

Our recorder and plain recorders run in turn, at 1000 Hz to measure their processor time, and then
at increasing rates. A recorder sustains a rate if no message at this rate or a lower rate is
missing. The time until the recorder is idle again counts for the rate. Offline, our reader and
`AnyReader` of rosbags read the same bags.
"""

from __future__ import annotations

import itertools
import struct
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import processes
import rclpy
from comparison import Comparison, Figure, Part, parse, parser, tracked, write
from rclpy.publisher import Publisher
from record_peer import SUBSCRIPTIONS
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from wall_bag import RATE, named_chain, write_wall_bag

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.reading import find_topic, open_bag
from soliton_linkage_nodes.messages.cdr import JointStateBuffer, JointStateDecoder
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames
from soliton_linkage_nodes.runtime import interfaces

ROTORS = (100, 1000)
OURS = 'ours'
PEERS = {'raw': 'rclpy, raw subscription', 'typed': 'rclpy, typed subscription'}
FASTEST = 64_000.0
SETTLING = 1.0
REACHED = 0.8
NAP = 0.0003
POLL = 0.1
IDLE = 0.3
LONGEST_DRAIN = 20.0
FRAMES = {100: 4000, 1000: 1500}
SECOND = 10**9
STAMP = struct.Struct('<4xiI')


@dataclass(frozen=True)
class Burst:
    """Messages published at one rate."""

    asked: float
    """Requested rate [1/s]."""
    sent: int
    sending: float
    """Duration of publishing [s]."""
    working: float
    """Time until the recorder was idle again [s]."""
    processor: float
    """Processor time of the recorder [s]."""

    @property
    def was_sent(self) -> bool:
        """Whether the requested rate was approximately reached."""
        return self.sent > REACHED * self.asked * self.sending


@dataclass(frozen=True)
class Trial:
    """Result of one recorder."""

    bursts: list[Burst]
    stored: Counter[int]
    """Number of recorded messages by the number of the burst."""

    def lost(self, number: int) -> int:
        """Return the number of missing messages of a burst."""
        return self.bursts[number].sent - self.stored[number]

    @property
    def share(self) -> float:
        """Processor load at 1000 Hz [% of a core]."""
        first = self.bursts[0]
        return 100 * first.processor / first.working

    @property
    def taken(self) -> float:
        """Highest rate up to which no message is lost [1/s], or 0."""
        whole = itertools.takewhile(lambda n: not self.lost(n), range(len(self.bursts)))
        return max((self.bursts[n].sent / self.bursts[n].working for n in whole), default=0.0)


def main() -> None:
    options = parser(__doc__)
    options.add_argument('--rotors', type=int, nargs='*', help=f'{ROTORS}')
    arguments = parse(options, rounds=(1, 3), rotors=(ROTORS[:1], ROTORS))
    rounds, sizes = arguments.rounds, arguments.rotors
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=arguments.output.parent) as folder:
        recorded = recording(Path(folder), sizes, rounds, arguments.quick)
        read = reading(Path(folder), sizes, rounds, arguments.quick)
    comparisons = [*recorded.comparisons, *read.comparisons]
    details = {**recorded.details, **read.details}
    write(Part('record', comparisons, recorded.figures, details), arguments.output)


def recording(folder: Path, sizes: Sequence[int], rounds: int, quick: bool) -> Part:
    """Compare the recorders."""
    comparisons, figures, details = [], [], {}
    kinds = (OURS, *SUBSCRIPTIONS)
    runs = list(itertools.product(sizes, range(rounds), kinds))
    trials: dict[int, dict[str, list[Trial]]] = {}
    progress = ProgressLine('recording', len(runs))
    for done, (rotors, turn, kind) in enumerate(runs):
        progress.show(done, f'{kind}, {rotors} rotors, round {turn + 1}')
        by_kind = trials.setdefault(rotors, {each: [] for each in kinds})
        by_kind[kind].append(trial(kind, rotors, folder, quick))
    progress.end(f'{len(runs)} recordings measured')
    for rotors, by_kind in trials.items():
        ours, work = by_kind[OURS], f'N = {rotors}'
        for kind, name in PEERS.items():
            shares = [[each.share for each in side] for side in (by_kind[kind], ours)]
            taken = [rates_taken(side) for side in (by_kind[kind], ours)]
            comparisons += [
                Comparison(name, f'record at {RATE} Hz, {work}', '% of a core', *shares),
                Comparison(name, f'record without loss, {work}', '/s', *taken, True),
            ]
        size = len(JointStateBuffer(named_chain(rotors))) / 1e6
        bytes_taken = [size * rate for rate in rates_taken(ours)]
        figures.append(Figure(f'recorded without loss, {work}', 'MB/s', bytes_taken))
        for kind, side in by_kind.items():
            details[f'{work}, {kind}'] = [
                [{**vars(one), 'lost': each.lost(n)} for n, one in enumerate(each.bursts)]
                for each in side
            ]
    return Part('record', comparisons, figures, details)


def rates_taken(trials: Sequence[Trial]) -> list[float]:
    """Return the sustained rates of all rounds [1/s]; empty if a round sustained none."""
    rates = [each.taken for each in trials]
    return rates if all(rates) else []


def trial(kind: str, rotors: int, folder: Path, quick: bool) -> Trial:
    """Record bursts of increasing rate with a recorder, until a rate cannot be published."""
    seconds, factor = (0.5, 4.0) if quick else (1.0, 2**0.5)
    bursts: list[Burst] = []
    with tempfile.TemporaryDirectory(dir=folder) as name:
        path = Path(name, 'run.mcap')
        command = processes.program_command(Path(__file__).with_name('record_peer.py'), kind, path)
        if kind == OURS:
            path = Path(name, 'run_0')
            command = processes.node_command('bag_recorder', {'output': Path(name, 'run')})
        with processes.own_domain(), processes.running(command) as recorder:
            send = Sender(rotors)
            bursts.append(send.burst(0, float(RATE), 2 * seconds, recorder.pid))
            rate = 2.0 * RATE
            while rate <= FASTEST and bursts[-1].was_sent:
                bursts.append(send.burst(len(bursts), rate, seconds, recorder.pid))
                rate *= factor
        return Trial(bursts, Counter(stamped_bursts(path)))


class Sender:
    """Publisher of joint states; each stamp contains the number of the burst as its seconds."""

    def __init__(self, rotors: int) -> None:
        topic = interfaces.JOINT_STATES
        self._node = rclpy.create_node('sender')
        self._publisher: Publisher = self._node.create_publisher(topic.type, topic.name, topic.qos)
        self._buffer, self._still = JointStateBuffer(named_chain(rotors)), np.zeros(rotors)
        processes.until(self._publisher.get_subscription_count, 'recorder')
        time.sleep(SETTLING)

    def burst(self, number: int, rate: float, seconds: float, recorder: int) -> Burst:
        """Publish at a rate if possible, and wait until the recorder is idle."""
        still, sent = self._still, 0
        processor, start = processes.processor_time(recorder), time.monotonic()
        while (now := time.monotonic() - start) < seconds:
            for _ in range(min(int(now * rate) + 1 - sent, 100)):
                stamp = number * SECOND + sent
                self._publisher.publish(bytes(self._buffer.fill(stamp, still, still, still)))
                sent += 1
            time.sleep(max(0.0, min(NAP, sent / rate - (time.monotonic() - start))))
        sending = time.monotonic() - start
        working = sending + self._drained(recorder)
        return Burst(rate, sent, sending, working, processes.processor_time(recorder) - processor)

    def _drained(self, recorder: int) -> float:
        """Wait until a recorder is idle; return the time at which it became idle [s]."""
        start = time.monotonic()
        while time.monotonic() - start < LONGEST_DRAIN:
            before, begin = processes.processor_time(recorder), time.monotonic()
            time.sleep(POLL)
            used = processes.processor_time(recorder) - before
            if used < IDLE * POLL:
                return begin - start
        return time.monotonic() - start


def stamped_bursts(path: Path) -> Iterator[int]:
    """Yield the number of the burst of each message in a recording."""
    with Reader(path) as reader:
        connections = [c for c in reader.connections if c.topic == '/joint_states']
        for _, _, data in reader.messages(connections):
            yield STAMP.unpack_from(data)[0]


def reading(folder: Path, sizes: Sequence[int], rounds: int, quick: bool) -> Part:
    """Compare reading and analysing a bag, in frames per second of processor time."""
    comparisons, details = [], {}
    for rotors in sizes:
        frames = 200 if quick else FRAMES.get(rotors, 1500)
        bag = write_wall_bag(folder / f'wall_{rotors}', rotors, frames)
        ways: dict[str, Callable[[Path], int]] = {
            'AnyReader': read_by_any_reader,
            'read and decode': read_by_ours,
            'analyse': analyse,
        }
        rates: dict[str, list[float]] = {name: [] for name in ways}
        for _ in tracked(range(rounds), f'reading {rotors} rotors'):
            for name, way in ways.items():
                start = time.thread_time()
                done = way(bag)
                rates[name].append(done / (time.thread_time() - start))
                if done != frames:
                    raise AssertionError(f'{name} read {done} of {frames} frames')
        theirs = rates.pop('AnyReader')
        peer = 'rosbags AnyReader, read and deserialize'
        comparisons += [
            Comparison(peer, f'{name}, N = {rotors}', 'frames/s', theirs, ours, True)
            for name, ours in rates.items()
        ]
        details[f'read, N = {rotors}'] = {'frames': frames}
    return Part('record', comparisons, details=details)


def read_by_any_reader(bag: Path) -> int:
    """Deserialise every frame of a bag with rosbags; return the number of frames."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == '/joint_states']
        messages = reader.messages(connections)
        return sum(bool(reader.deserialize(data, c.msgtype)) for c, _, data in messages)


def read_by_ours(bag: Path) -> int:
    """Decode every frame of a bag with the suite; return the number of frames."""
    decoder = JointStateDecoder()
    with open_bag(bag) as reader:
        joints = find_topic(reader, 'joint_states')
        messages = reader.messages([joints])
        return sum(decoder.decode(data) is not None for _, _, data in messages)


def analyse(bag: Path) -> int:
    """Analyse every frame of a bag; return the number of frames."""
    with open_bag(bag) as reader:
        return sum(1 for _ in analyse_frames(reader))


if __name__ == '__main__':
    main()
