# SPDX-License-Identifier: Apache-2.0
"""Controls of the chain identifier, and what it has found."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial

from nicegui import ui

from soliton_linkage_nodes.live_view.chain_topics import REPORTS_LAST
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    Chosen,
    ControlGroup,
    View,
    button,
)
from soliton_linkage_nodes.live_view.status import reports_of
from soliton_linkage_nodes.messages.view_conversions import NodeReport, figure

_IDENTIFIER = 'chain_identifier'


class IdentifyControls:
    """Identify, save, begin anew, and the proposal in words."""

    def __init__(self, view: View, chosen: Chosen) -> None:
        """Build them for the chain that is chosen when they are used."""
        self._view, self._chosen = view, chosen
        self._begun = time.monotonic()
        self._group = ControlGroup('Identify the chain', 'identify')
        with self._group.body:
            for text, what, icon in (
                ('Identify', 'identify', 'straighten'),
                ('Save', 'save', 'save'),
                ('Begin anew', 'forget', 'restart_alt'),
            ):
                button(text, partial(self._ask, what), icon, f'live-identifier-{what}')
            self._progress = ui.linear_progress(show_value=False).props(
                'indeterminate aria-label="identifying" id=live-identifying'
            )
            self._progress.set_visibility(False)
        self._lines = ui.label().classes('live-lines').props('id=live-identified role=status')
        ui.label(
            'It takes all frames so far: let a soliton pass the whole chain first, best several '
            'times. Save writes the proposal to a file of parameters, with standard deviations, '
            'which the nodes take by --params-file.'
        ).classes('live-hint')

    def refresh(self, why: Mapping[str, str]) -> None:
        """Grey what can do nothing now, and tell what was found."""
        self._group.heed(why[self._group.reason_of])
        name = f'{self._chosen.namespace}{_IDENTIFIER}'
        reports = reports_of(self._view.finder, self._chosen.namespace)
        told_lately = (r for age, r in reports if r.node == name and age < REPORTS_LAST)
        report = next(told_lately, None)
        working = report is not None and report.figures.get('identifying') == 'True'
        if not working:
            self._begun = time.monotonic()
        if self._progress.visible != working:
            self._progress.set_visibility(working)
        span = f'identifying for {time.monotonic() - self._begun:.0f} s' if working else ''
        words = '\n'.join(in_words(report, span)) if report else ''
        if self._lines.text != words:
            self._lines.text = words

    async def _ask(self, what: str) -> str:
        return await self._view.commands(self._chosen.namespace).of_identifier(what)


def in_words(report: NodeReport, working: str = '') -> list[str]:
    """Lines that tell what the chain identifier reports, and that it is `working`."""
    figures = report.figures
    found = 'noise [rad]' in figures
    lines = [', '.join(filter(None, (f'{figures.get("frames", "?")} frames', working)))]
    if found or report.level or not working:
        lines += report.message.split('; ')
    if figures.get('worst bonds'):
        lines.append(f'worst bonds: {figures["worst bonds"]}')
    if found:
        lines.append(f'noise of the angles: {figure(figures, "noise [rad]"):.2g} rad')
        lines.append(f'lengths of one kind differ by {100 * figure(figures, "tolerance"):.2g} %')
    return lines
