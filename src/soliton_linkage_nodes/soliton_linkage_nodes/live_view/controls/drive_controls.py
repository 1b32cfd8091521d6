# SPDX-License-Identifier: Apache-2.0
"""Controls of a chain (nudge, edge commands, tilt, moves) and of the time of a simulation."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

from nicegui import ui

from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.status import CONTROLS, gravity_of
from soliton_linkage_nodes.live_view.stream import View
from soliton_linkage_nodes.messages.view_conversions import STATES

_KINDS = {'kick': 'kick [rad/s]', 'pulse': 'pulse [N m]', 'pressure': 'pressure [Pa]'}
_USUAL_VALUES = {'kick': 10.0, 'pulse': 0.002, 'pressure': 20_000.0}
"""Default value of an edge command [rad/s, N m, Pa]: it sends a soliton along the usual chain."""
_USUAL_NUDGE = 10.0
"""Default speed of a nudge [rad/s]: that of the experiments."""
_FASTEST_NUDGE = 50.0
"""Speed at the end of the slider [rad/s]."""
_STEEPEST = 0.5
"""Tilt at the end of the slider [rad]."""
_FACTORS = (0.01, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 0.0)
"""Real-time factors [1]; 0 is as fast as possible."""

Action = Callable[[], 'str | Awaitable[str]']


class Shown(Protocol):
    """The chain that a page shows."""

    namespace: str


async def attempt(action: Action) -> bool:
    """Carry out an action and show its result; return False if it was rejected."""
    try:
        done = action()
        said = done if isinstance(done, str) else await done
    except (ValueError, OSError) as error:
        complain(error)
        return False
    if said:
        ui.notify(said, type='positive', timeout=2000, position='bottom-right')
    return True


def complain(error: Exception) -> None:
    """Show an error for a while."""
    ui.notify(str(error), type='negative', multi_line=True, timeout=6000, position='bottom-right')


def button(text: str, action: Action, icon: str = '', marker: str = '') -> ui.button:
    """Add a button that carries out an action and shows its result."""

    async def press() -> None:
        await attempt(action)

    made = ui.button(text, icon=icon or None, on_click=press).props('dense no-caps unelevated')
    return made.props(f'id={marker}') if marker else made


def number(label: str, value: float, unit: str, **props: Any) -> ui.number:
    """Add a field for a number with its unit."""
    made = ui.number(label, value=value, format='%g', **props).props('dense outlined')
    return made.props(f'suffix="{unit}"').classes('live-number')


def value_of(entry: ui.number, name: str) -> float:
    """Return the number in a field; raise ValueError if it is empty."""
    if entry.value is None:
        raise ValueError(f'{name} is empty; enter a number')
    return float(entry.value)


class ControlGroup:
    """Controls under a heading that are disabled together, with a reason."""

    def __init__(self, title: str, reason_of: str) -> None:
        """`reason_of` is the name of the reason in `status.reasons`."""
        self.reason_of = reason_of
        self._shown: str | None = None
        with ui.element('fieldset').classes('live-group') as self.box:
            ui.element('legend').props(f'innerHTML="{title}"')
            self.body = ui.element('div').classes('live-row')
            self.why = ui.label().classes('live-reason')

    def disable_for(self, reason: str) -> None:
        """Disable the controls if there is a reason, and show it."""
        if reason == self._shown:
            return
        self._shown = reason
        self.why.text = reason
        self.why.set_visibility(bool(reason))
        if reason:
            self.box.props('disabled')
        else:
            self.box.props(remove='disabled')
        for element in self.body.descendants():
            if isinstance(element, ui.element) and hasattr(element, 'set_enabled'):
                element.set_enabled(not reason)


class DriveControls:
    """Nudges, edge commands, tilt and moves."""

    def __init__(self, view: View, page: Shown) -> None:
        """Build the controls for the chain that the page shows."""
        self._view, self._page = view, page
        self.groups = [self._nudge(), self._command(), self._tilt(), *self._move()]

    @property
    def _commands(self) -> ChainCommands:
        return self._view.commands(self._page.namespace)

    def _nudge(self) -> ControlGroup:
        group = ControlGroup('Nudge the edge', 'nudge')
        with group.body:
            slider = ui.slider(
                min=-_FASTEST_NUDGE, max=_FASTEST_NUDGE, step=0.5, value=_USUAL_NUDGE
            )
            slider.props('label aria-label="strength of a nudge [rad/s]" id=live-nudge-strength')
            slider.classes('live-slider')
            entry = number('strength', _USUAL_NUDGE, 'rad/s').bind_value(slider)
            slider.on_value_change(
                lambda e: ui.run_javascript(f'live.strength = {float(e.value or 0)}')
            )
            button(
                'Nudge',
                lambda: self._commands.nudge(value_of(entry, 'strength')),
                'bolt',
                'live-nudge',
            )
        return group

    def _command(self) -> ControlGroup:
        group = ControlGroup('Kick, pulse or pressure', 'drive')
        with group.body:
            kind = ui.select(_KINDS, value='kick', label='kind').props('dense outlined')
            edge = ui.select(['nearest', 'first', 'last'], value='nearest', label='edge')
            edge.props('dense outlined')
            value = number('value', _USUAL_VALUES['kick'], '')
            duration = number('duration', 0.1, 's', min=0)
            up = number('ramp up', 0.0, 's', min=0)
            down = number('ramp down', 0.0, 's', min=0)
            timed = (duration, up, down)

            def adapt() -> None:
                value.value = _USUAL_VALUES[kind.value]
                for field in timed:
                    field.set_visibility(kind.value != 'kick')

            kind.on_value_change(adapt)
            adapt()

            def send() -> str:
                times = [
                    value_of(f, n)
                    for f, n in zip(timed, ('duration', 'ramp up', 'ramp down'), strict=True)
                ]
                if kind.value == 'kick':
                    times = [0.0, 0.0, 0.0]
                spans = (times[0], times[1], times[2])
                return self._commands.drive(
                    kind.value, edge.value, value_of(value, 'value'), spans
                )

            button('Send', send, 'send', 'live-send')
        return group

    def _tilt(self) -> ControlGroup:
        group = ControlGroup('Tilt', 'tilt')
        with group.body:
            slider = ui.slider(min=-_STEEPEST, max=_STEEPEST, step=0.005, value=0.0)
            slider.props('label aria-label="tilt [rad]" id=live-tilt').classes('live-slider')

            async def turn() -> None:
                try:
                    self._commands.tilt(float(slider.value))
                except ValueError as error:
                    complain(error)

            slider.on('change', turn, throttle=0.1)
            slider.on('update:model-value', turn, throttle=0.1)
            self._slope = ui.label().classes('live-hint')
        return group

    def _move(self) -> tuple[ControlGroup, ControlGroup]:
        group = ControlGroup('Carry the soliton', 'move')
        with group.body:
            rotor = number('to rotor', 10.0, '', min=0)
            speed = number('speed, 0 for the best', 0.0, 'rotors/s', min=0)
            rotor.props('id=live-move-rotor')

            async def carry() -> str:
                chain = self._view.finder.chains[self._page.namespace]
                now = chain.model.numbers.get('rotor', float('nan'))
                return await self._commands.carry(
                    value_of(rotor, 'rotor'), value_of(speed, 'speed'), now
                )

            button('Carry', carry, 'moving', 'live-carry')
            button('Cancel', lambda: self._commands.cancel(), 'cancel', 'live-cancel')
            ui.label('Or click on the chain.').classes('live-hint')
        held = ControlGroup('Let go', 'release')
        with held.body:
            button('Release', lambda: self._commands.release(), 'back_hand', 'live-release')
        return group, held

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable inactive controls."""
        for group in self.groups:
            group.disable_for(why[group.reason_of])
        gravity, tilt = gravity_of(self._view.finder, self._page.namespace)
        told = '' if tilt != tilt else f'now {tilt:.3f} rad'
        if gravity == 0:
            told = f'{told}; without gravity it does nothing: set gravity.acceleration'
        if self._slope.text != told:
            self._slope.text = told


class RunControls:
    """Pause, step, reset and pace of a simulation."""

    def __init__(self, view: View, page: Shown) -> None:
        """Build the controls for the chain that the page shows."""
        self._view, self._page = view, page
        self.groups = [self._pause(), self._step(), self._reset(), self._pace()]

    @property
    def _commands(self) -> ChainCommands:
        return self._view.commands(self._page.namespace)

    def _pause(self) -> ControlGroup:
        group = ControlGroup('Time', 'pause')
        with group.body:
            button('Pause', lambda: self._commands.pause(True), 'pause', 'live-pause')
            button('Go on', lambda: self._commands.pause(False), 'play_arrow', 'live-resume')
        return group

    def _step(self) -> ControlGroup:
        group = ControlGroup('Step, while paused', 'step')
        with group.body:
            periods = number('periods', 10, '', min=1, precision=0)
            button(
                'Step',
                lambda: self._commands.step(value_of(periods, 'periods')),
                'skip_next',
                'live-step',
            )
        return group

    def _reset(self) -> ControlGroup:
        group = ControlGroup('Reset', 'reset')
        with group.body:
            state = ui.select(list(STATES), value='initial', label='state').props('dense outlined')
            state.props('id=live-reset-state')
            place = number('place', 10.0, 'rotors')
            velocity = number('velocity', 0.0, 'm/s')
            angles = ui.input('angles [rad]', placeholder='rotor_0: 1.2, rotor_5: -0.5')
            angles.props('dense outlined').classes('live-wide')

            def adapt() -> None:
                for field in (place, velocity):
                    field.set_visibility(state.value == 'soliton')
                angles.set_visibility(state.value == 'angles')

            state.on_value_change(adapt)
            adapt()

            async def reset() -> str:
                soliton, joints = state.value == 'soliton', state.value == 'angles'
                return await self._commands.reset(
                    state.value,
                    value_of(place, 'place') if soliton else 0.0,
                    value_of(velocity, 'velocity') if soliton else 0.0,
                    joint_angles(angles.value or '') if joints else None,
                )

            button('Reset', reset, 'restart_alt', 'live-reset')
        return group

    def _pace(self) -> ControlGroup:
        group = ControlGroup('Simulated over real time', 'pause')
        with group.body:
            offered = {
                factor: f'{factor:g} ×' if factor else 'as fast as possible' for factor in _FACTORS
            }
            factor = ui.select(offered, value=1.0, label='real-time factor')
            factor.props('dense outlined id=live-factor').classes('live-wide')

            async def change() -> str:
                commands = self._commands
                node = f'{commands.namespace}simulator'
                known = {p.name: p for p in await commands.parameters(node)}
                return await commands.set_parameter(node, known['real_time_factor'], factor.value)

            button('Set', change, 'speed', 'live-pace')
        return group

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable inactive controls."""
        for group in self.groups:
            group.disable_for(why[group.reason_of])


def joint_angles(text: str) -> dict[str, float]:
    """Return angles by joint from a text such as 'rotor_0: 1.2'; raise ValueError otherwise."""
    angles = {}
    for part in filter(None, (p.strip() for p in text.split(','))):
        name, _, value = part.partition(':')
        try:
            angles[name.strip()] = float(value)
        except ValueError as error:
            raise ValueError(
                f'{part!r} is no angle; write joint and angle, as in rotor_0: 1.2'
            ) from error
    if not angles:
        raise ValueError('no angle is given; write joint and angle, as in rotor_0: 1.2')
    return angles


def reasons_for(view: View, namespace: str) -> dict[str, str]:
    """Return the reason why each control of a chain is inactive."""
    missing = {'': 'choose a chain'}.get(namespace, 'the chain is gone')
    return view.reasons.get(namespace) or dict.fromkeys(CONTROLS, missing)
