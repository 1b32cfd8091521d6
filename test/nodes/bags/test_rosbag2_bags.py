# SPDX-License-Identifier: Apache-2.0
"""Bags in rosbag2 layouts, with joint states only, are read, checked and recovered."""

import pytest
from backports import zstd
from recordings import MILLISECOND, START, frame_message
from rosbag2_bags import LAYOUTS, Layout, write_rosbag2_bag

from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag


@pytest.fixture(params=LAYOUTS)
def layout(request):
    return LAYOUTS[request.param]


@pytest.fixture
def frames(named):
    return [(START + n * MILLISECOND, frame_message(named, n)) for n in range(100)]


def test_it_is_read_whole_and_comes_back_whole(layout, frames, tmp_path):
    bag = write_rosbag2_bag(tmp_path / 'rosbag2_2026', layout, frames)
    report = check_bag(bag)
    assert (report.damage, report.messages, report.lost) == ([], 100, 0)
    _, new = recover_bag(bag, tmp_path / 'new')
    for path in (bag, new):
        with open_bag(path) as reader:
            assert list(read_topic(reader, 'joint_states')) == frames
    (bag / 'metadata.yaml').unlink()
    report, new = recover_bag(bag, tmp_path / 'new')
    assert report.damage == ['metadata.yaml is missing or cannot be read']
    with open_bag(new) as reader:
        assert list(read_topic(reader, 'joint_states')) == frames


@pytest.mark.parametrize('name', ['mcap without chunks', 'mcap in lz4 chunks', 'sqlite3'])
def test_an_unfinished_file_gives_its_messages(name, frames, tmp_path):
    bag = write_rosbag2_bag(tmp_path / 'rosbag2_2026', LAYOUTS[name], frames)
    (bag / 'metadata.yaml').unlink()
    (data,) = bag.iterdir()
    whole = data.read_bytes()
    data.write_bytes(whole[: len(whole) // 2])
    report, new = recover_bag(bag, tmp_path / 'new')
    with open_bag(new) as reader:
        held = list(read_topic(reader, 'joint_states'))
    assert len(held) == report.messages > 15
    assert all(entry in frames for entry in held)


def test_messages_before_the_cut_of_a_compressed_file_are_recovered(frames, tmp_path):
    layout = Layout('sqlite3', compression_mode='FILE')
    bag = write_rosbag2_bag(tmp_path / 'rosbag2_2026', layout, frames)
    (packed,) = bag.glob('*.zstd')
    plain = zstd.decompress(packed.read_bytes())
    pieces = b''.join(
        zstd.compress(plain[begin : begin + 8192]) for begin in range(0, len(plain), 8192)
    )
    packed.write_bytes(pieces[: len(pieces) // 2])
    report = check_bag(bag)
    assert 'compressed data is truncated' in report.damage[0]
    assert report.messages + report.lost >= len(frames)


def test_damage_to_a_file_without_chunks_loses_one_message(frames, tmp_path):
    bag = write_rosbag2_bag(tmp_path / 'rosbag2_2026', LAYOUTS['mcap without chunks'], frames)
    (data,) = bag.glob('*.mcap')
    whole = data.read_bytes()
    stamp = frames[50][0].to_bytes(8, 'little')
    head = whole.index(stamp) - 15
    assert whole[head] == 5
    damaged = bytearray(whole)
    damaged[head : head + 9] = bytes(9)
    data.write_bytes(damaged)
    report, new = recover_bag(bag, tmp_path / 'new')
    assert report.messages == 99
    with open_bag(new) as reader:
        held = list(read_topic(reader, 'joint_states'))
    assert held == frames[:50] + frames[51:]
