# SPDX-License-Identifier: Apache-2.0
"""Controls of the chain identifier and of the adjustable parameters of nodes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import ui

from soliton_linkage_nodes.live_view.chain_topics import REPORTS_LAST
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    ControlGroup,
    Shown,
    attempt,
    button,
    complain,
)
from soliton_linkage_nodes.live_view.status import reports_of
from soliton_linkage_nodes.live_view.stream import View
from soliton_linkage_nodes.messages.view_conversions import (
    AdjustableParameter,
    NodeReport,
    figure,
)

_IDENTIFIER = 'chain_identifier'


class IdentifyControls:
    """Identify, save, restart, and the result."""

    def __init__(self, view: View, page: Shown) -> None:
        """Build the controls for the chain that the page shows."""
        self._view, self._page = view, page
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
        """Disable inactive controls and show the result."""
        self._group.disable_for(why[self._group.reason_of])
        name = f'{self._page.namespace}{_IDENTIFIER}'
        reports = reports_of(self._view.finder, self._page.namespace)
        told_lately = (r for age, r in reports if r.node == name and age < REPORTS_LAST)
        report = next(told_lately, None)
        working = report is not None and report.figures.get('identifying') == 'True'
        if not working:
            self._begun = time.monotonic()
        if self._progress.visible != working:
            self._progress.set_visibility(working)
        span = f'identifying for {time.monotonic() - self._begun:.0f} s' if working else ''
        text = '\n'.join(describe(report, span)) if report else ''
        if self._lines.text != text:
            self._lines.text = text

    async def _ask(self, what: str) -> str:
        return await self._view.commands(self._page.namespace).of_identifier(what)


def describe(report: NodeReport, working: str = '') -> list[str]:
    """Return the report of the chain identifier as lines; `working` tells its progress."""
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


class ParameterControls:
    """A field for each adjustable parameter of the selected node."""

    def __init__(self, view: View, page: Shown) -> None:
        """Offer the nodes of the chain's namespace."""
        self._view, self._page = view, page
        self._offered: list[str] = []
        with ui.element('div').classes('live-row'):
            self._nodes = ui.select([], label='node', on_change=self._show)
            self._nodes.props('dense outlined id=live-parameter-node').classes('live-wide')
            ui.button(icon='refresh', on_click=self._show).props(
                'flat dense aria-label="read again"'
            )
        self._fields = ui.element('div').classes('live-parameters')

    def refresh(self) -> None:
        """Update the list of nodes."""
        namespace = self._page.namespace
        nodes = sorted(
            node for node in self._view.finder.nodes if node.rpartition('/')[0] + '/' == namespace
        )
        if nodes != self._offered:
            self._offered = nodes
            kept = self._nodes.value if self._nodes.value in nodes else None
            self._nodes.set_options({node: node.rpartition('/')[2] for node in nodes}, value=kept)

    async def _show(self) -> None:
        self._fields.clear()
        node = self._nodes.value
        if not node:
            return
        try:
            found = await self._view.commands(self._page.namespace).parameters(node)
        except ValueError as error:
            complain(error)
            return
        self._fields.clear()
        with self._fields:
            for parameter in found:
                self._field(node, parameter)
            if not found:
                ui.label('It has none that may be changed.').classes('live-hint')

    def _field(self, node: str, parameter: AdjustableParameter) -> None:
        async def change(event: Any) -> None:
            commands = self._view.commands(self._page.namespace)
            value = event.value if hasattr(event, 'value') else entry.value
            changed = await attempt(lambda: commands.set_parameter(node, parameter, value))
            if not changed:
                await self._show()

        entry: Any
        if parameter.kind == 'bool':
            entry = ui.switch(parameter.name, value=bool(parameter.value), on_change=change)
        elif parameter.choices:
            entry = ui.select(
                list(parameter.choices),
                value=parameter.value,
                label=parameter.name,
                on_change=change,
            )
        elif parameter.kind in ('int', 'float'):
            entry = ui.number(parameter.name, value=float(parameter.value), format='%g')
            entry.on('change', change)
        else:
            entry = ui.input(parameter.name, value=str(parameter.value))
            entry.on('change', change)
        entry.props('dense outlined').classes('live-wide')
        if self._view.read_only:
            entry.set_enabled(False)
        ui.label(meaning(parameter)).classes('live-hint')


def meaning(parameter: AdjustableParameter) -> str:
    """Return the description of a parameter with its range."""
    low, high = parameter.minimum, parameter.maximum
    bounds = [
        f'from {low:g}' if low is not None and low > -1e300 else '',
        f'to {high:g}' if high is not None and high < 1e300 else '',
    ]
    told = ' '.join(filter(None, bounds))
    return f'{parameter.description}; {told}' if told else parameter.description
