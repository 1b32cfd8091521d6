# SPDX-License-Identifier: Apache-2.0
"""A malicious bag uses little memory and time; its intact part is recovered."""

import signal
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from hostile_bags import CASES, MEBIBYTE, SQLITE_CASES, base, write_hostile
from recordings import data_file

from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.reading import message_class, open_bag
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag

SIZE = 100_000
LIMITS = BagLimits(max_unpacked=2 * MEBIBYTE, max_unpacked_file=8 * MEBIBYTE)
MOST_MEMORY = 40 * MEBIBYTE
LONGEST = 120.0
NOTHING_LEFT = {
    'pipe as data',
    'link to a device as data',
    'link out of the bag as data',
    'nothing but zeros: mcap',
    'nothing but zeros: sqlite3',
    'page size of 65536',
    'page size of 4095',
    'view without end',
    'view that spins',
    'generated gigabytes',
}
NAMED_LIMITS = {
    'zstd bomb: file': 'max_unpacked_file = 8388608',
    'zstd bomb: honest chunk': 'max_unpacked = 2097152',
    'zstd bomb: message': 'max_unpacked = 2097152',
}
Held = set[tuple[str, int, int]]


@contextmanager
def bounded() -> Iterator[None]:
    """Fail where something hangs or takes much memory."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f'it hangs for {LONGEST} s')

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
        assert peak < MOST_MEMORY
    finally:
        tracemalloc.stop()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def contents(bag: Path) -> Held:
    """Topic, stamp and size of each message: what pads a message differs from time to time."""
    with open_bag(bag, LIMITS) as reader:
        found = reader.messages(reader.topics)
        return {(each.name, stamp, len(data)) for each, stamp, data in found}


def attempt(act: Callable[[], object]) -> str:
    """The line with which something is refused, empty where it is not."""
    said = ''
    try:
        act()
    except ValueError as error:
        said = str(error)
    assert '\n' not in said
    assert len(said) < 2000
    return said


@pytest.mark.parametrize('case', CASES)
def test_intact_messages_are_recovered_in_bounded_memory_and_time(case, named, tmp_path):
    storage = 'sqlite3' if case in SQLITE_CASES else 'mcap'
    sent = contents(base(tmp_path / 'sent', named, storage))
    bag = write_hostile(case, tmp_path / 'hostile', named, SIZE)
    with bounded():
        checked = attempt(lambda: check_bag(bag, limits=LIMITS))
        read = attempt(lambda: contents(bag))
        refused = attempt(lambda: recover_bag(bag, tmp_path / 'new', limits=LIMITS))
    if case in NOTHING_LEFT:
        assert refused
        assert read
        return
    assert not checked
    held = contents(tmp_path / 'new_0')
    assert sent <= held
    if case in NAMED_LIMITS:
        assert NAMED_LIMITS[case] in '; '.join([*check_bag(bag, limits=LIMITS).damage, read])


@pytest.mark.parametrize(
    'case', ['pipe as metadata', 'link to a device as metadata', 'laughs in metadata']
)
def test_invalid_metadata_is_reported_with_its_reason(case, named, tmp_path):
    bag = write_hostile(case, tmp_path / 'hostile', named, SIZE)
    (damage,) = check_bag(bag).damage
    assert damage.startswith('metadata.yaml cannot be read: ')
    assert 'metadata.yaml' in attempt(lambda: contents(bag))


def test_links_to_a_bag_and_within_it_are_followed(named, tmp_path):
    bag = base(tmp_path / 'run', named)
    sent = contents(bag)
    data = data_file(bag)
    data.rename(bag / 'kept')
    data.symlink_to('kept')
    (tmp_path / 'latest').symlink_to(bag)
    for path in (bag, tmp_path / 'latest'):
        assert contents(path) == sent
        assert check_bag(path).damage == []


@pytest.mark.parametrize(
    'case', ['many channels', 'one channel many times', 'many topics', 'repeated definitions']
)
def test_the_work_for_many_definitions_is_proportional_to_their_number(case, named, tmp_path):
    lines = []
    for size in (20_000, 80_000):
        bag = write_hostile(case, tmp_path / f'hostile{size}', named, size)
        lines.append(0)

        def count(*_: object) -> Any:
            lines[-1] += 1
            return count

        before = sys.gettrace()
        sys.settrace(count)
        try:
            recover_bag(bag, tmp_path / 'new')
            attempt(lambda bag=bag: contents(bag))
        finally:
            sys.settrace(before)
    assert lines[1] < 6 * lines[0]


def test_no_more_topics_are_played_than_publishers_are_cheap(graph, named, tmp_path):
    bag = write_hostile('many topics', tmp_path / 'hostile', named, 400_000)
    with pytest.raises(ValueError, match='has 2003 topics, and at most 1000 are played; name'):
        graph.start(BagPlayer, {'bag': str(bag)})


def test_limits_of_the_player_are_parameters(graph, named, tmp_path):
    bag = write_hostile('zstd bomb: honest chunk', tmp_path / 'hostile', named, SIZE)
    player = graph.start(
        BagPlayer, {'bag': str(bag), 'subscriber_timeout': 0.0, 'max_unpacked': 2 * MEBIBYTE}
    )
    graph.until(lambda: player.failure, 'the refusal')
    assert 'a chunk would decompress to more than max_unpacked = 2097152 bytes' in str(
        player.failure
    )


def test_the_name_of_a_type_runs_no_code(tmp_path, monkeypatch):
    (tmp_path / 'strange_code.py').write_text('raise SystemExit')
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match='is not installed'):
        message_class('strange_code/msg/Name')
