# SPDX-License-Identifier: Apache-2.0
"""Controls of a waveform on an edge rotor, and of the motors of a simulated chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from nicegui import ui

from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    ChainControls,
    Shown,
    attempt,
    button,
    number,
    scale,
    value_of,
)
from soliton_linkage_nodes.live_view.view import View

_UNITS = {'torque': 'N m', 'angle': 'rad'}
_AMPLITUDES = {'torque': 0.002, 'angle': 0.1}
"""Default amplitude of a torque [N m] and of an angle [rad], sufficient to move a kink
(soliton with the charge +1)."""
_LARGEST_COUPLING = 1e-3
"""Largest non-reciprocity on the slider if the non-reciprocity of the chain is 0 [N m/rad]."""


class WaveControls(ChainControls):
    """Controls of a waveform and of the motors. The frequency slider shows the phonon band."""

    def __init__(self, view: View, page: Shown) -> None:
        super().__init__(view, page)
        self._chain: Chain | None = None
        self._waveform()
        self._motors()

    def _waveform(self) -> None:
        with self._group('Waveform of an edge rotor', 'drive'):
            self._shape = ui.select(['burst', 'chirp', 'noise'], value='burst', label='shape')
            self._edge = ui.select(['first', 'last'], value='first', label='driven edge')
            self._quantity = ui.select(list(_UNITS), value='torque', label='quantity')
            for each in (self._shape, self._edge, self._quantity):
                each.props('dense outlined')
            self._value = number('amplitude', _AMPLITUDES['torque'], _UNITS['torque'])
            self._slider = ui.slider(min=1.0, max=100.0, step=0.5, value=40.0)
            label = 'angular frequency [rad/s]'
            self._slider.props(f'label aria-label="{label}" id=live-frequency')
            self._slider.classes('live-slider')
            frequency = number('frequency', 40.0, 'rad/s', min=0).bind_value(self._slider)
            last = number('to', 60.0, 'rad/s', min=0)
            cycles, duration = number('cycles', 20.0, '', min=0), number('length', 3.0, 's')
            self._band = ui.label().classes('live-hint').props('id=live-band role=status')

            cycles.bind_visibility_from(self._shape, 'value', value='burst')
            for field in (last, duration):
                field.bind_visibility_from(self._shape, 'value', lambda each: each != 'burst')

            def convert() -> None:
                self._value.value = _AMPLITUDES[self._quantity.value]
                self._value.props(f'suffix="{_UNITS[self._quantity.value]}"')

            self._quantity.on_value_change(convert)

            async def send() -> str:
                burst = self._shape.value == 'burst'
                given = {'cycles': cycles} if burst else {'last_frequency': last}
                return await self._commands.drive(
                    'waveform',
                    self._edge.value,
                    value_of(self._value),
                    (0.0 if burst else value_of(duration), 0.0, 0.0),
                    shape=self._shape.value,
                    quantity=self._quantity.value,
                    frequency=value_of(frequency),
                    **{name: value_of(field) for name, field in given.items()},
                )

            button('Send waveform', send, 'waves', 'live-wave')

    def _motors(self) -> None:
        with self._group('Motors: non-reciprocal coupling κ of a simulated chain', 'pause'):
            self._coupling = ui.slider(
                min=-_LARGEST_COUPLING, max=_LARGEST_COUPLING, step=1e-6, value=0.0
            )
            self._coupling.props('aria-label="non-reciprocity [N m/rad]" id=live-coupling')
            self._coupling.classes('live-slider')

            async def change() -> None:
                name = 'chain.non_reciprocity'
                await attempt('Motors', partial(self._set_in_simulator, name, self._coupling))

            self._coupling.on('change', change)
            self._current = ui.label().classes('live-hint').props('id=live-motors role=status')

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable the groups with a reason in `why`, and mark the phonon band on the slider."""
        super().refresh(why)
        shown = self._view.chains.get(self._page.namespace)
        named = shown.model.named if shown else None
        if named is None or named.chain == self._chain:
            return
        known, self._chain = self._chain, named.chain
        kappa = named.chain.non_reciprocity
        self._current.text = (
            f'κ = {kappa:.3g} N m/rad: torque of the motors of a bond per difference of its '
            'angles; 0: no motors'
        )
        if known == replace(named.chain, non_reciprocity=known.non_reciprocity if known else 0.0):
            return
        largest = 2 * abs(kappa) or _LARGEST_COUPLING
        # The slider rounds its value to as many decimal places as the step has.
        self._coupling.props(f'step={largest / 100:.12f}')
        scale(self._coupling, -largest, largest, 'N m/rad')
        self._coupling.value = kappa
        low, high = band_edges(named.chain)
        end = 2 * high
        scale(self._slider, 1.0, end, 'rad/s')
        self._slider.value = round((low + high) / 2, 1)
        first, second = (100 * (edge - 1) / (end - 1) for edge in (low, high))
        self._slider.style(
            f'background: linear-gradient(to right, transparent {first:.1f}%, '
            f'#e69f0066 {first:.1f}%, #e69f0066 {second:.1f}%, transparent {second:.1f}%) '
            '0 0 / 100% 28px no-repeat content-box'
        )
        self._band.text = (
            f'Phonon band, shaded: {low:.3g} to {high:.3g} rad/s. '
            'Waves of other frequencies do not propagate.'
        )
