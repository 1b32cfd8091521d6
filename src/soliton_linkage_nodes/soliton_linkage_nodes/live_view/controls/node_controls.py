# SPDX-License-Identifier: Apache-2.0
"""Controls of the chain identifier and of the adjustable parameters of nodes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import ui

from soliton_linkage_nodes.live_view.chain_topics import REPORT_TIMEOUT
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    ChainControls,
    Shown,
    attempt,
    button,
    hint,
)
from soliton_linkage_nodes.live_view.status import reports_of
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.messages.view_conversions import AdjustableParameter, NodeReport, figure
from soliton_linkage_nodes.runtime.parameters import describe_range

_HINT = (
    'Identify estimates the lengths of the rotors and springs from all frames received so far. '
    'Let a soliton pass through the whole chain first, preferably several times. Save writes the '
    'result with its standard deviations to a parameter file; start nodes with --params-file to '
    'use it.'
)


class IdentifyControls(ChainControls):
    """Controls of the chain identifier, and the result of the identification."""

    def __init__(self, view: View, page: Shown) -> None:
        super().__init__(view, page)
        with self._group('Identify the chain', 'identify'):
            for text, name, icon in (
                ('Identify', 'identify', 'straighten'),
                ('Save', 'save', 'save'),
                ('Forget frames', 'forget', 'restart_alt'),
            ):
                action = partial(self._request, name)
                button(text, action, icon, f'live-identifier-{name}', name == 'identify')
            self._progress = ui.linear_progress(show_value=False).props(
                'aria-label="progress of the identification" id=live-identifying'
            )
            self._progress.set_visibility(False)
        self._lines = ui.label().classes('live-lines').props('id=live-identified role=status')
        hint(_HINT)

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable the controls that have no effect now, and show the result."""
        super().refresh(why)
        name = f'{self._page.namespace}chain_identifier'
        reports = reports_of(self._view.finder, self._page.namespace)
        recent = ((a, r) for a, r in reports if r.node == name and a < REPORT_TIMEOUT)
        age, report = next(recent, (math.nan, None))
        figures = report.figures if report else {}
        running = figures.get('identifying') == 'True'
        self._progress.set_visibility(running)
        if running:
            self._progress.value = float(figures.get('progress', '0').rstrip('%')) / 100
        seconds = figure(figures, 'identifying for [s]') + age
        elapsed = f'identifying for {seconds:.0f} s' if running else ''
        self._lines.text = '\n'.join(describe(report, elapsed)) if report else ''

    async def _request(self, name: str) -> str:
        return await self._commands.call_identifier(name)


def describe(report: NodeReport, progress: str = '') -> list[str]:
    """Return the report of the chain identifier as lines of text.

    While an identification is running, `progress` describes its progress. Otherwise it is ''.
    """
    figures = report.figures
    found = 'noise [rad]' in figures
    lines = [', '.join(filter(None, (f'{figures.get("frames", "?")} frames', progress)))]
    if progress:
        # Omit the last result or failure, because it belongs to earlier frames.
        return lines
    lines += report.message.split('; ')
    if figures.get('worst bonds'):
        lines.append(f'least accurate springs or bars: {figures["worst bonds"]}')
    if found:
        lines.append(f'noise of the angles: {figure(figures, "noise [rad]"):.2g} rad')
        tolerance = 100 * figure(figures, 'tolerance')
        lines.append(f'standard deviation of lengths of one kind: {tolerance:.2g} %')
    return lines


class ParameterControls:
    """Fields with the adjustable parameters of the selected node."""

    def __init__(self, view: View, page: Shown) -> None:
        self._view, self._page = view, page
        self._offered: list[str] = []
        with ui.element('div').classes('live-row'):
            self._nodes = ui.select([], label='node', on_change=self._show)
            self._nodes.props('dense outlined id=live-parameter-node').classes('live-wide')
            ui.button(icon='refresh', on_click=self._show).props(
                'flat dense aria-label="read the parameters again"'
            )
        self._fields = ui.element('div').classes('live-parameters')

    def refresh(self) -> None:
        """Update the list of the nodes in the namespace of the chain."""
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
        found: list[AdjustableParameter] = []

        async def read() -> str:
            found.extend(await self._view.commands(self._page.namespace).parameters(node))
            return ''

        if not await attempt(f'Parameters of {node}', read):
            return
        self._fill(node, found)

    def _fill(self, node: str, found: list[AdjustableParameter]) -> None:
        self._fields.clear()
        with self._fields:
            for parameter in found:
                self._field(node, parameter)
            if not found:
                hint('No parameter of this node can be changed while it runs.')

    def _field(self, node: str, parameter: AdjustableParameter) -> None:
        async def change(event: Any) -> None:
            commands = self._view.commands(self._page.namespace)
            value = event.value if hasattr(event, 'value') else entry.value
            changed = await attempt('Set', lambda: commands.set_parameter(node, parameter, value))
            if not changed:
                # Keep the reason of the rejection on the page.
                with contextlib.suppress(ValueError, OSError):
                    self._fill(node, await commands.parameters(node))

        entry: Any
        name = parameter.name
        if parameter.kind is bool:
            entry = ui.switch(name, value=bool(parameter.value), on_change=change)
        elif parameter.range.choices:
            choices = list(parameter.range.choices)
            entry = ui.select(choices, value=parameter.value, label=name, on_change=change)
        elif parameter.kind in (int, float):
            entry = ui.number(name, value=float(parameter.value), format='%g')
            entry.on('change', change)
        else:
            entry = ui.input(name, value=str(parameter.value))
            entry.on('change', change)
        entry.props('dense outlined').classes('live-wide')
        if self._view.read_only:
            entry.set_enabled(False)
        hint(description(parameter))


def description(parameter: AdjustableParameter) -> str:
    """Return the description and the allowed range of a parameter."""
    allowed = '' if parameter.range.choices else describe_range(parameter.range)
    return '; '.join(filter(None, (parameter.description, allowed)))
