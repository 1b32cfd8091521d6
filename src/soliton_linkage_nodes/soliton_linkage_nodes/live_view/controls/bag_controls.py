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
from soliton_linkage_nodes.live_view.view import View

_RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Selectable speeds of a replay relative to the recorded speed [1]."""
_REQUESTS = (
    ('Pause recording', 'pause', 'pause'),
    ('New file', 'split_bagfile', 'call_split'),
    ('Snapshot', 'snapshot', 'photo_camera'),
)


class RecordControls:
    """Controls of a recording."""

    def __init__(self, view: View, page: Shown) -> None:
        self._view, self._page = view, page
        self._group = ControlGroup('Record this chain to a bag')
        with self._group.body:
            kept = number('only keep the last', 0.0, 's', min=0, max=3600)
            kept.tooltip('0 records everything; otherwise Snapshot writes the last seconds')
            record = partial(self._record, kept)
            self._start = button(
                'Record', record, 'fiber_manual_record', 'live-record', primary=True, long=True
            )
            self._requests = [
                button(text, partial(view.recording.request, name), icon, f'live-record-{name}')
                for text, name, icon in _REQUESTS
            ]
            self._stop = button('Stop', view.recording.stop, 'stop', 'live-record-stop')
        self._summary = ui.label().classes('live-hint').props('id=live-recording role=status')

    async def _record(self, kept: ui.number) -> str:
        recording = self._view.recording
        if recording.report is not None:
            return await recording.request('resume')
        if self._page.namespace not in self._view.chains:
            raise ValueError('select the chain to record')
        return await recording.start(self._page.namespace, value_of(kept))

    def refresh(self) -> None:
        """Disable the controls that have no effect now, and show the state of the recording."""
        recording = self._view.recording
        if not recording.running and self._page.namespace in self._view.chains:
            recording.namespace = self._page.namespace
        report = recording.report
        reason = '' if report and not self._view.read_only else recording.rejection
        self._group.disable_for(reason)
        if not reason:
            paused = report is not None and report.message.startswith('paused')
            self._start.set_enabled(paused or not (report or recording.running))
            for requested in self._requests:
                requested.set_enabled(report is not None)
            self._stop.set_enabled(recording.running)
        figures = report.figures if report else {}
        name = figures.get('bag', '').rpartition('/')[2]
        self._summary.text = (
            f'{name}: {report.message}; {figures.get("messages", "?")} messages, '
            f'{figures.get("lost messages", "?")} lost'
            if report
            else ''
        )


class BagControls:
    """List of recorded bags, and the controls of the replay."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._listings = 0
        self._finished = view.recording.finished
        self._rows: dict[str, tuple[CataloguedBag | None, ui.element]] = {}
        self._transport = ControlGroup('Replay of a bag')
        with self._transport.body:
            self._pausing = button('Pause', self._pause, 'pause', 'live-replay-play')
            rate = ui.select({r: f'{r:g} ×' for r in _RATES}, value=1.0, label='speed')
            rate.props('dense outlined id=live-replay-rate')
            loop = ui.switch('repeat', value=False).props('id=live-replay-loop')
            button('End', view.replay.stop, 'close', 'live-replay-end')

            async def change_rate() -> None:
                await attempt('Speed', lambda: view.replay.set_rate(float(rate.value)))

            async def change_loop() -> None:
                await attempt('Repeat', lambda: view.replay.set_loop(bool(loop.value)))

            rate.on_value_change(change_rate)
            loop.on_value_change(change_loop)
        with ui.element('div').classes('live-row'):
            ui.label('Recorded bags').classes('live-title')
            ui.button('Refresh', icon='refresh', on_click=self.list_bags).props(
                'flat dense no-caps id=live-bags-list'
            )
        self._list = ui.element('div').classes('live-bags').props('id=live-bags')

    def refresh(self) -> None:
        """Disable the replay controls if no bag is open. Update the list after a recording."""
        read_only = READ_ONLY if self._view.read_only else ''
        closed = '' if self._view.replay.bag else 'no bag is open; press Play beside a bag'
        self._transport.disable_for(read_only or closed)
        self._pausing.text = 'Pause' if self._plays else 'Play'
        self._pausing.icon = 'pause' if self._plays else 'play_arrow'
        if self._finished != self._view.recording.finished:
            self._finished = self._view.recording.finished
            ui.timer(0, self.list_bags, once=True)

    async def list_bags(self) -> None:
        """Read the bag folders and update the list of bags."""
        self._listings += 1
        listing = self._listings
        bags = {bag.name: bag for bag in await asyncio.to_thread(self._view.catalogue.bags)}
        # Keep the rows of unchanged bags, because the user may be about to press their buttons.
        for name, (shown, row) in list(self._rows.items()):
            if shown is None or shown != bags.get(name):
                row.delete()
                del self._rows[name]
        with self._list:
            for index, (name, bag) in enumerate(bags.items()):
                if name in self._rows:
                    continue
                row = self._row(bag)
                row.move(target_index=index)
                self._rows[name] = bag, row
                # Give the server time to send frames.
                await asyncio.sleep(0)
                if listing != self._listings:
                    return
            if not bags:
                folders = ', '.join(map(str, self._view.catalogue.folders))
                text = f'No bags in {folders}.' if folders else 'No folder for bags is set.'
                remedy = '' if folders else ' Start live_view with bag_folders.'
                self._rows[''] = None, ui.label(text + remedy).classes('live-hint')

    def _row(self, bag: CataloguedBag) -> ui.element:
        with ui.element('div').classes('live-bag') as row:
            with ui.element('div'):
                ui.label(bag.name).classes('live-bag-name')
                topics = sorted((name.lstrip('/'), n) for name, n in bag.topics.items() if n)
                contents = ', '.join(f'{count} {name}' for name, count in topics)
                lost = f', {bag.lost} messages lost' if bag.lost else ''
                text = f'{bag.duration:.1f} s{lost}: {contents}' if contents else f'empty{lost}'
                ui.label(text).classes('live-hint')
            play = button('Play', partial(self._view.replay.play, bag.name), 'play_arrow')
            play.set_enabled(bool(bag.played and contents) and not self._view.read_only)
        return row

    @property
    def _plays(self) -> bool:
        return self._view.replay.running and not self._view.replay.paused

    async def _pause(self) -> str:
        return await self._view.replay.pause(self._plays)
