# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from programs import until

from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.runtime.stamps import SECOND


def test_a_bag_is_recorded_split_and_finished(visit, view):
    visit.tab('Bags')
    before = {bag.path for bag in view.catalogue.bags()}
    visit.click('record')
    visit.answers('recording to ')
    visit.has_text('health', '● recorder: recording')
    until(lambda: int(view.recording.report.figures['messages']) > 20, 'messages')
    assert visit.page.locator('#live-record').is_disabled()
    visit.page.locator('#live-record-pause').click()
    visit.answers('paused')
    visit.has_text('recording', ': paused')
    visit.page.locator('#live-record:enabled').click()
    visit.answers('resumed')
    visit.page.locator('#live-record-split_bagfile').click()
    visit.answers('started a new file')
    visit.click('record-snapshot')
    visit.answers('snapshot_duration of bag_recorder = 0')
    visit.click('record-stop')
    visit.answers('the bag is complete')
    (bag,) = [bag for bag in view.catalogue.bags() if bag.path not in before]
    assert bag.name.startswith('recording_')
    visit.page.locator('.live-bag', has_text=bag.name).wait_for()
    assert visit.text('recording') == ''
    assert bag.lost == 0
    assert bag.topics['/joint_states'] > 10
    assert len(list(bag.path.glob('*.mcap*'))) == 2


def test_a_snapshot_keeps_the_last_seconds(visit, view):
    visit.tab('Bags')
    before = {bag.path for bag in view.catalogue.bags()}
    visit.fill('only keep the last', 2)
    visit.click('record')
    until(lambda: view.recording.report, 'the recorder')
    visit.page.locator('#live-record-snapshot:enabled').click()
    until(lambda: int(view.recording.report.figures['messages']) > 0, 'the snapshot')
    visit.click('record-stop')
    until(lambda: {bag.path for bag in view.catalogue.bags()} - before, 'the finished bag')
    (path,) = {bag.path for bag in view.catalogue.bags()} - before
    # Latched messages are older.
    with open_bag(path) as reader:
        stamps = [stamp for stamp, _ in read_topic(reader, 'joint_states')]
    assert 0 < max(stamps) - min(stamps) <= 2 * SECOND
    visit.fill('only keep the last', 0)


def test_a_bag_is_played_beside_the_chain_with_seek_rate_and_loop(visit, view):
    visit.tab('Bags')
    visit.click('bags-list')
    bag = visit.page.locator('.live-bag:has-text("flipper_0")')
    bag.get_by_text('joint_states').wait_for()
    bag.get_by_role('button').click()
    visit.wait('live.watched.startsWith("/replay/")')
    visit.wait('live.shown && live.shown.rotors > 2 && live.status.replay.position > 0.2')
    visit.wait(
        '!document.getElementById("live-time-figure").hidden && live.time.track.length > 50'
    )
    visit.has_text('health', 'replay of flipper_0')
    assert 'flipper_0' in visit.text('time-note')
    visit.click('replay-play')
    until(lambda: view.replay.paused, 'the pause')
    track = visit.page.locator('#live-time')
    whole = view.replay.bag.duration

    def sought() -> bool:
        width = track.bounding_box()['width']
        track.click(position={'x': 10 + 0.9 * (width - 20), 'y': 30})
        # The page may have moved under the pointer.
        visit.page.wait_for_timeout(500)
        return (view.replay.position or 0) > 0.85 * whole

    until(sought, 'the frame at this time')
    visit.answers('paused at ')
    visit.wait('live.status.replay.paused && live.shown.state_age - live.shown.age < 2')
    visit.wait('document.getElementById("live-stale").textContent === "paused"')
    visit.page.focus('#live-time')
    visit.page.keyboard.press('PageDown')
    until(lambda: view.replay.position < 0.8 * whole, 'an earlier time')
    visit.click('replay-play')
    visit.choose('speed', '10 ×')
    until(lambda: view.replay.rate == 10.0, 'the rate')
    until(lambda: not view.replay.running, 'the end')
    visit.has_text('stale', 'end of the replay')
    visit.click('replay-loop')
    until(lambda: view.replay.loop, 'the loop')
    visit.click('replay-play')
    until(
        lambda: view.replay.running and (view.replay.position or 0) < 0.3 * whole, 'the beginning'
    )
    until(lambda: (view.replay.position or 0) > 0.7 * whole, 'the end')
    until(lambda: view.replay.position < 0.3 * whole, 'the beginning again')
    assert view.replay.running
    visit.tab('Drive')
    visit.panel_has_text('this chain is a replay')
    visit.tab('Bags')
    visit.click('replay-loop')
    visit.click('replay-end')
    visit.wait('live.watched === "/" && live.shown.rotors === 12')
