# SPDX-License-Identifier: Apache-2.0
"""Controls of the recorder and of the player, and the list of bags."""

from __future__ import annotations

import asyncio
from functools import partial

from nicegui import ui

from soliton_linkage_nodes.live_view.bag_catalogue import CataloguedBag
from soliton_linkage_nodes.live_view.commands import READ_ONLY
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    ControlGroup,
    Shown,
    attempt,
    button,
    number,
    value_of,
)
from soliton_linkage_nodes.live_view.status import REPLAY
from soliton_linkage_nodes.live_view.stream import View

_RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Rates of a replay over that of the recording [1]."""


class RecordControls:
    """Start, pause, split, snapshot and stop."""

    def __init__(self, view: View, page: Shown) -> None:
        """Record the chain that the page shows."""
        self._view, self._page = view, page
        self._start = ControlGroup('Record', 'start')
        with self._start.body:
            kept = number('only keep the last', 0.0, 's', min=0, max=3600)
            kept.tooltip('0 records all; with some seconds, a snapshot writes what came in them')
            button(
                'Start',
                lambda: self._begin(value_of(kept, 'seconds')),
                'fiber_manual_record',
                'live-record',
            )
        self._going = ControlGroup('Recording', 'ask')
        with self._going.body:
            button('Pause', partial(self._ask, 'pause'), 'pause', 'live-record-pause')
            button('Go on', partial(self._ask, 'resume'), 'play_arrow', 'live-record-resume')
            button('Split', partial(self._ask, 'split_bagfile'), 'call_split', 'live-record-split')
            button(
                'Snapshot', partial(self._ask, 'snapshot'), 'photo_camera', 'live-record-snapshot'
            )
        self._end = ControlGroup('Finish', 'stop')
        with self._end.body:
            button('Stop', view.recording.stop, 'stop', 'live-record-stop')
        self._told = ui.label().classes('live-hint').props('id=live-recording')

    def _begin(self, kept: float) -> str:
        if self._view.read_only:
            raise ValueError(READ_ONLY)
        if self._page.namespace not in self._view.finder.chains:
            raise ValueError('choose a chain to record')
        return self._view.recording.start(self._page.namespace, kept)

    async def _ask(self, what: str) -> str:
        recording = self._view.recording
        return await recording.ask(self._view.commands(recording.namespace), what)

    def refresh(self) -> None:
        """Disable inactive controls and show the state of the recording."""
        recording = self._view.recording
        if not recording.running and self._page.namespace in self._view.finder.chains:
            recording.namespace = self._page.namespace
        read_only = READ_ONLY if self._view.read_only else ''
        report = recording.report
        going = '' if report else 'nothing is being recorded'
        foreign = 'it was started elsewhere: end it there' if report else going
        running = 'it is recording' if recording.running else ''
        self._start.disable_for(read_only or recording.refusal or running)
        self._going.disable_for(read_only or going)
        self._end.disable_for(read_only or ('' if recording.running else foreign))
        told = ''
        if report:
            figures = report.figures
            name = figures.get('bag', '').rpartition('/')[2]
            told = (
                f'{name}: {report.message}; {figures.get("messages", "?")} messages, '
                f'{figures.get("lost messages", "?")} lost'
            )
        if self._told.text != told:
            self._told.text = told


class BagControls:
    """The list of bags and the controls of the replay."""

    def __init__(self, view: View, page: Shown) -> None:
        """Build an empty list."""
        self._view, self._page = view, page
        self._listings = 0
        self._rows: dict[str, tuple[CataloguedBag | None, ui.element]] = {}
        with ui.element('div').classes('live-row'):
            ui.label('Bags').classes('live-title')
            ui.button('Look again', icon='refresh', on_click=self.list_bags).props(
                'flat dense no-caps id=live-bags-look'
            )
        self._list = ui.element('div').classes('live-bags').props('id=live-bags')
        self._transport = ControlGroup('Replay', 'replay')
        with self._transport.body:
            button('Pause', lambda: self._pause(True), 'pause', 'live-replay-pause')
            button('Play', lambda: self._pause(False), 'play_arrow', 'live-replay-play')
            rate = ui.select({r: f'{r:g} ×' for r in _RATES}, value=1.0, label='rate')
            rate.props('dense outlined id=live-replay-rate')
            loop = ui.switch('loop', value=False).props('id=live-replay-loop')
            button('End', view.replay.stop, 'close', 'live-replay-end')

            async def change_rate() -> None:
                commands = view.commands(REPLAY)
                await attempt(lambda: view.replay.set_rate(commands, float(rate.value)))

            async def change_loop() -> None:
                await attempt(lambda: view.replay.set_loop(bool(loop.value)))

            rate.on_value_change(change_rate)
            loop.on_value_change(change_loop)

    def refresh(self) -> None:
        """Disable the controls of the replay while no bag is played."""
        read_only = READ_ONLY if self._view.read_only else ''
        none = '' if self._view.replay.bag else 'no bag is being played'
        self._transport.disable_for(read_only or none)

    async def list_bags(self) -> None:
        """List the bags of the folders."""
        self._listings += 1
        listing = self._listings
        bags = {bag.name: bag for bag in await asyncio.to_thread(self._view.catalogue.bags)}
        # Rows of the same bags stay, because a user may be about to press their buttons.
        for name, (shown, row) in list(self._rows.items()):
            if shown is None or shown != bags.get(name):
                row.delete()
                del self._rows[name]
        with self._list:
            for place, (name, bag) in enumerate(bags.items()):
                if name in self._rows:
                    continue
                row = self._row(bag)
                row.move(target_index=place)
                self._rows[name] = bag, row
                # Let the server send pictures.
                await asyncio.sleep(0)
                if listing != self._listings:
                    return
            if not bags:
                self._rows[''] = None, self._none()

    def _none(self) -> ui.element:
        folders = ', '.join(map(str, self._view.catalogue.folders))
        return ui.label(
            f'No bags in {folders}.'
            if folders
            else 'No folder was named: start live_view with bag_folders.'
        ).classes('live-hint')

    def _row(self, bag: CataloguedBag) -> ui.element:
        with ui.element('div').classes('live-bag') as row:
            with ui.element('div'):
                ui.label(bag.name).classes('live-bag-name')
                topics = sorted((name.lstrip('/'), n) for name, n in bag.topics.items() if n)
                held = ', '.join(f'{count} {name}' for name, count in topics)
                lost = f', {bag.lost} lost' if bag.lost else ''
                told = f'{bag.duration:.1f} s{lost}: {held}' if held else f'holds nothing{lost}'
                ui.label(told).classes('live-hint')
            play = button('Play', partial(self._view.replay.play, bag.name), 'play_arrow')
            play.set_enabled(bool(bag.played and held) and not self._view.read_only)
        return row

    async def _pause(self, paused: bool) -> str:
        return await self._view.replay.pause(self._view.commands(REPLAY), paused)
