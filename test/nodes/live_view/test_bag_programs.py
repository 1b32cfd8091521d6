# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest
from recordings import run_of, write_bag

from soliton_linkage_nodes.live_view.bag_catalogue import BagCatalogue
from soliton_linkage_nodes.live_view.bag_programs import BagRecording, BagReplay
from soliton_linkage_nodes.live_view.commands import READ_ONLY
from soliton_linkage_nodes.messages.view_conversions import NodeReport


class Commands:
    """Commands that fail the test if they call a service."""

    def __init__(self, read_only: bool) -> None:
        self.read_only = read_only

    def __call__(self, _: str) -> Commands:
        return self

    async def call(self, *_: Any) -> None:
        raise AssertionError('the page called a service')

    def check_writable(self) -> None:
        if self.read_only:
            raise ValueError(READ_ONLY)


def finder(*reports: str) -> Any:
    received = {name: (time.monotonic(), NodeReport(name, 0, 'recording', {})) for name in reports}
    return SimpleNamespace(reports=received, chains={})


RECORDER: dict[str, Callable[[BagRecording], Any]] = {
    'start': lambda recording: recording.start('/'),
    'stop': lambda recording: recording.stop(),
    'pause': lambda recording: recording.request('pause'),
    'snapshot': lambda recording: recording.request('snapshot'),
}
PLAYER: dict[str, Callable[[BagReplay], Awaitable[str]]] = {
    'play': lambda replay: replay.play('bag_0'),
    'pause': lambda replay: replay.pause(True),
    'loop': lambda replay: replay.set_loop(True),
    'rate': lambda replay: _at_rate(replay),
}


async def _at_rate(replay: BagReplay) -> str:
    replay.running = True
    return await replay.set_rate(2.0)


def run(action: Any) -> None:
    async def wait() -> None:
        await action

    asyncio.run(wait())


def test_a_read_only_page_records_nothing(tmp_path):
    for name in RECORDER:
        recording = BagRecording(tmp_path, finder(), Commands(read_only=True))
        with pytest.raises(ValueError, match='this page is read-only'):
            run(RECORDER[name](recording))
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name', PLAYER)
def test_a_read_only_page_plays_nothing(tmp_path, named, name):
    write_bag(tmp_path / 'bag', run_of(named, 3))
    replay = BagReplay(BagCatalogue([tmp_path]), tmp_path, finder(), Commands(read_only=True))
    with pytest.raises(ValueError, match='this page is read-only'):
        run(PLAYER[name](replay))
    assert (replay.bag, replay.rate, replay.loop) == (None, 1.0, False)


def test_no_recorder_is_started_beside_one_of_another_program(tmp_path):
    recording = BagRecording(tmp_path, finder('/bag_recorder'), Commands(read_only=False))
    with pytest.raises(ValueError, match='another program is recording this chain'):
        recording.begin('/')


def test_without_a_folder_nothing_is_recorded():
    recording = BagRecording(None, finder(), Commands(read_only=False))
    with pytest.raises(ValueError, match='start live_view with bag_folders'):
        recording.begin('/')


class SimulatedRecorder(BagRecording):
    """Recording without a process."""

    def begin(self, namespace: str, snapshot: float = 0.0) -> str:
        self.running = True
        return 'recording'


def test_record_answers_when_the_recorder_is_connected_to_all_publishers(tmp_path):
    found = finder('/bag_recorder')
    recording = SimulatedRecorder(tmp_path, found, Commands(read_only=False))

    def report(message: str) -> None:
        received = time.monotonic(), NodeReport('/bag_recorder', 0, message, {})
        found.reports['/bag_recorder'] = received

    async def record() -> None:
        report('discovering publishers')
        answer = asyncio.ensure_future(recording.start('/'))
        await asyncio.sleep(0.2)
        assert not answer.done()
        report('recording')
        assert await answer == 'recording to recording_0'

    asyncio.run(record())


def test_stop_waits_for_the_state_of_the_newest_frame(tmp_path):
    found = finder()
    recording = SimulatedRecorder(tmp_path, found, Commands(read_only=False))
    recording.begin('/')
    analysed = iter([False, False, True])
    asked: list[int] = []

    def is_analysed(stamp: int) -> bool:
        assert recording.running
        asked.append(stamp)
        return next(analysed)

    found.chains['/'] = SimpleNamespace(newest_frame=7, is_analysed=is_analysed)
    assert asyncio.run(recording.stop()) == 'the bag is complete'
    assert asked == [7, 7, 7]
