# SPDX-License-Identifier: Apache-2.0
import math

import pytest
from recordings import START, run_of, write_bag

from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.live_view.bag_catalogue import BagCatalogue, track_of
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


def state(second: float, rotor: float) -> SolitonState:
    message = SolitonState(solitons=[] if math.isnan(rotor) else [Soliton(rotor=rotor)])
    message.header.stamp = time_to_msg(START + round(second * 1e9))
    return message


def test_readable_bags_are_listed_newest_first(tmp_path, named):
    for name in ('one', 'two'):
        write_bag(tmp_path / name, run_of(named, 5))
    later = [(topic, stamp + 10**9, message) for topic, stamp, message in run_of(named, 8)]
    write_bag(tmp_path / 'three', later)
    (tmp_path / 'no_bag').mkdir()
    (tmp_path / 'damaged').mkdir()
    (tmp_path / 'damaged' / 'metadata.yaml').write_text('rosbag2_bagfile_information: 7')
    bags = BagCatalogue([tmp_path]).bags()
    assert bags[0].name == 'three_0'
    assert {bag.name for bag in bags} == {'one_0', 'two_0', 'three_0'}
    assert bags[0].topics == {'/nudge': 1, '/joint_states': 8, '/chain': 1}
    assert bags[0].duration == pytest.approx(0.008)
    assert sorted(bags[0].played) == ['/chain', '/joint_states']


def test_the_recorded_time_has_no_pauses(tmp_path, named):
    gaps = [(START + 10**9, START + 3 * 10**9), (START + 7 * 10**9, START + 8 * 10**9)]
    write_bag(tmp_path / 'run', run_of(named, 10, 10**9), gaps=gaps)
    (bag,) = BagCatalogue([tmp_path]).bags()
    assert bag.duration == pytest.approx(7.0)
    for time, since in ((0.5, 0.5), (1.5, 3.5), (4.5, 6.5), (5.5, 8.5), (7.0, 10.0)):
        stamp = bag.stamp_of(time)
        assert stamp == START + round(since * 10**9)
        assert bag.time_of(stamp) == pytest.approx(time)


@pytest.mark.parametrize('name', ['../secret_0', '/etc', 'secret_0', '', '..', 'link_0'])
def test_bags_in_other_folders_are_not_opened(tmp_path, named, name):
    folder = tmp_path / 'folder'
    folder.mkdir()
    write_bag(folder / 'own', run_of(named, 3))
    secret = write_bag(tmp_path / 'secret', run_of(named, 3))
    (folder / 'link_0').symlink_to(secret)
    with pytest.raises(ValueError, match=r'no folder of bag_folders .* contains the bag'):
        BagCatalogue([folder]).bag(name)
    assert BagCatalogue([folder]).bag('own_0').name == 'own_0'


def test_the_track_gives_the_position_of_the_soliton_over_time(tmp_path, named):
    entries = run_of(named, 3)
    entries += [
        (interfaces.SOLITON_STATE, START + n * 10**7, state(0.01 * n, rotor))
        for n, rotor in enumerate((0.0, 1.0, math.nan, 3.0))
    ]
    write_bag(tmp_path / 'bag', sorted(entries, key=lambda entry: entry[1]))
    track = track_of(BagCatalogue([tmp_path]).bag('bag_0'))
    assert track.points == ((0.0, 0.0), (0.01, 1.0), (0.02, None), (0.03, 3.0))
    assert track.time_of(START / 10**9 + 0.01) == pytest.approx(0.01, abs=1e-6)
    write_bag(tmp_path / 'stateless', run_of(named, 3))
    stateless = track_of(BagCatalogue([tmp_path]).bag('stateless_0'))
    assert stateless.points == ()
    assert math.isfinite(stateless.time_of(START / 10**9))


def test_the_time_of_a_frame_is_that_of_its_point_although_the_delay_varies(tmp_path, named):
    received = [0.0, 0.01, 2.5, 2.51, 2.52, 2.6]
    entries = run_of(named, 3)
    entries += [
        (interfaces.SOLITON_STATE, START + round(at * 10**9), state(0.02 * n, float(n)))
        for n, at in enumerate(received)
    ]
    write_bag(tmp_path / 'bag', sorted(entries, key=lambda entry: entry[1]))
    track = track_of(BagCatalogue([tmp_path]).bag('bag_0'))
    times = [track.time_of(START / 10**9 + 0.02 * n) for n in range(len(received))]
    assert [at for at, _ in track.points] == pytest.approx(times, abs=1e-6)
    assert times == pytest.approx(received, abs=1e-6)


def test_without_folders_there_are_no_bags():
    assert BagCatalogue([]).bags() == []
    with pytest.raises(ValueError, match='none is set'):
        BagCatalogue([]).bag('bag_0')
