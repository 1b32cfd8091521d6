# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of a chain that may be changed, with their ranges and units."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from soliton_linkage_nodes.live_view.controls.drive_controls import Chosen, View, attempt, complain
from soliton_linkage_nodes.messages.view_conversions import AdjustableParameter


class ParameterControls:
    """A field for each adjustable parameter of a node that is chosen."""

    def __init__(self, view: View, chosen: Chosen) -> None:
        """Offer the nodes of the chain's namespace."""
        self._view, self._chosen = view, chosen
        self._offered: list[str] = []
        with ui.element('div').classes('live-row'):
            self._nodes = ui.select([], label='node', on_change=self._show)
            self._nodes.props('dense outlined id=live-parameter-node').classes('live-wide')
            ui.button(icon='refresh', on_click=self._show).props(
                'flat dense aria-label="read again"'
            )
        self._fields = ui.element('div').classes('live-parameters')

    def refresh(self) -> None:
        """Offer the nodes that run now."""
        namespace = self._chosen.namespace
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
            found = await self._view.commands(self._chosen.namespace).parameters(node)
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
            commands = self._view.commands(self._chosen.namespace)
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
    """What a parameter is, with its unit and its range."""
    low, high = parameter.minimum, parameter.maximum
    bounds = [
        f'from {low:g}' if low is not None and low > -1e300 else '',
        f'to {high:g}' if high is not None and high < 1e300 else '',
    ]
    told = ' '.join(filter(None, bounds))
    return f'{parameter.description}; {told}' if told else parameter.description
