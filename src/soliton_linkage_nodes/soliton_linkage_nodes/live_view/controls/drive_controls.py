# SPDX-License-Identifier: Apache-2.0
"""Controls of nudges, edge commands, tilts and moves, and of the run of a simulation."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

from nicegui import ui

from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.status import CONTROLS, gravity_of
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.messages.view_conversions import STATES

_KINDS = {'kick': 'kick [rad/s]', 'pulse': 'pulse [N m]', 'pressure': 'pressure [Pa]'}
_DEFAULT_VALUES = {'kick': 10.0, 'pulse': 0.002, 'pressure': 20_000.0}
"""Default value of each kind of edge command, sufficient to start a soliton [rad/s, N m, Pa]."""
_DEFAULT_NUDGE = 10.0
"""Initial angular speed on the slider of the nudge [rad/s], as in the guided experiments."""
_FASTEST_NUDGE = 50.0
"""Largest angular speed of a nudge on the slider [rad/s]."""
_LARGEST_TILT = 0.5
"""Largest tilt on the slider [rad]."""
_FACTORS = (0.01, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 0.0)
"""Selectable real-time factors [1]. At 0 the simulation runs as fast as possible."""
_EXAMPLE = 'write joint and angle, for example rotor_0: 1.2'

_numbers = itertools.count()
Action = Callable[[], 'str | Awaitable[str]']


class Shown(Protocol):
    """Object that contains the namespace of the chain that a page shows."""

    namespace: str


async def attempt(name: str, action: Action, long: bool = False) -> bool:
    """Carry out an action, show its answer, and return whether the action has succeeded.

    Unless `long` is set, the page shows after 2 s that no answer has arrived yet.
    """
    number = next(_numbers)
    show_answer(number, name, long=long)
    good = True
    try:
        done = action()
        text = done if isinstance(done, str) else await done
    except (ValueError, OSError) as error:
        text, good = str(error), False
    show_answer(number, name, text, good)
    return good


def show_answer(
    number: int, name: str, text: str = '', good: bool | None = None, long: bool = False
) -> None:
    """Show the state of an action.

    `number` identifies the action, and `text` is its answer. `good` is whether the action has
    succeeded. Before the answer, `good` is None.
    """
    state = {'id': f'control {number}', 'name': name, 'answer': text, 'good': good, 'long': long}
    ui.run_javascript(f'window.live?.answers.show({json.dumps(state)})')


def button(
    text: str,
    action: Action,
    icon: str = '',
    marker: str = '',
    primary: bool = False,
    long: bool = False,
) -> ui.button:
    """Add a button that carries out an action by `attempt`.

    `marker` is the HTML id. A `primary` button is filled. `long` is passed to `attempt`.
    """

    async def press() -> None:
        await attempt(text, action, long)

    created = ui.button(text, icon=icon or None, on_click=press)
    created.props(f'dense no-caps {"unelevated" if primary else "outline"}')
    return created.props(f'id={marker}') if marker else created


def number(label: str, value: float, unit: str, **props: Any) -> ui.number:
    """Add a field for a number, and show the unit in it."""
    created = ui.number(label, value=value, format='%g', **props).props('dense outlined')
    return created.props(f'suffix="{unit}"').classes('live-number')


def scale(slider: ui.slider, low: float, high: float, unit: str) -> None:
    """Set the range of a slider, and label both ends and the middle."""
    # Beyond the rounded ends the slider shows no label.
    low, high = (float(f'{end:.6g}') for end in (low, high))
    middle = (low + high) / 2
    texts = {low: f'{low:.3g}', middle: f'{middle:.3g} {unit}', high: f'{high:.3g}'}
    labels = [{'value': v, 'label': text.replace('-', '−')} for v, text in texts.items()]
    slider.props(f"min={low:g} max={high:g} :marker-labels='{json.dumps(labels)}'")


def hint(text: str) -> None:
    """Add an explanation."""
    ui.label(text).classes('live-hint')


def value_of(entry: ui.number) -> float:
    """Return the number in a field. Raises ValueError if the field is empty."""
    if entry.value is None:
        raise ValueError(f'{entry.props["label"]} is empty; enter a number')
    return float(entry.value)


class ControlGroup:
    """Controls under one heading."""

    def __init__(self, title: str) -> None:
        self._shown: str | None = None
        with ui.element('fieldset').classes('live-group') as self.box:
            ui.element('legend').props(f'innerHTML="{title}"')
            self.body = ui.element('div').classes('live-row')
            self._reason = ui.label().classes('live-reason')

    def disable_for(self, reason: str) -> None:
        """Show a reason and disable the controls. If the reason is '', enable the controls."""
        if reason == self._shown:
            return
        self._shown = reason
        self._reason.text = reason
        self._reason.set_visibility(bool(reason))
        if reason:
            self.box.props('disabled')
        else:
            self.box.props(remove='disabled')
        for element in self.body.descendants():
            if isinstance(element, ui.element) and hasattr(element, 'set_enabled'):
                element.set_enabled(not reason)


class ChainControls:
    """Groups of controls for the chain that the page shows."""

    def __init__(self, view: View, page: Shown) -> None:
        self._view, self._page = view, page
        self._groups: list[tuple[ControlGroup, str]] = []

    @property
    def _commands(self) -> ChainCommands:
        return self._view.commands(self._page.namespace)

    def _group(self, title: str, reason_of: str) -> ui.element:
        """Add a group, and return the element to which its controls are added.

        `reason_of` is the key under which `refresh` receives the reason to disable the group.
        """
        group = ControlGroup(title)
        self._groups.append((group, reason_of))
        return group.body

    async def _set_in_simulator(self, name: str, control: ui.select | ui.slider) -> str:
        commands = self._commands
        node = f'{commands.namespace}simulator'
        known = {each.name: each for each in await commands.parameters(node)}
        # Read the value last, because it may arrive after the event that reports its change.
        return await commands.set_parameter(node, known[name], float(control.value))

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable the groups for which `why` contains a reason, and enable the others."""
        for group, reason_of in self._groups:
            group.disable_for(why[reason_of])


class DriveControls(ChainControls):
    """Controls of nudges, edge commands, tilts and moves."""

    def __init__(self, view: View, page: Shown) -> None:
        super().__init__(view, page)
        self._nudge()
        self._move()
        self._command()
        self._tilt()

    def _nudge(self) -> None:
        with self._group('Nudge: a short push on the edge rotor', 'nudge'):
            slider = ui.slider(
                min=-_FASTEST_NUDGE, max=_FASTEST_NUDGE, step=0.5, value=_DEFAULT_NUDGE
            )
            slider.props('label aria-label="speed of a nudge [rad/s]" id=live-nudge-strength')
            scale(slider, -_FASTEST_NUDGE, _FASTEST_NUDGE, 'rad/s')
            slider.classes('live-slider')
            entry = number('speed', _DEFAULT_NUDGE, 'rad/s').bind_value(slider)
            slider.on_value_change(
                lambda e: ui.run_javascript(
                    f'if (window.live) live.nudgeSpeed = {float(e.value or 0)}'
                )
            )
            button(
                'Nudge',
                lambda: self._commands.nudge(value_of(entry)),
                'bolt',
                'live-nudge',
                primary=True,
            )

    def _command(self) -> None:
        with self._group('Kick, torque pulse or pressure at an edge', 'drive'):
            kind = ui.select(_KINDS, value='kick', label='kind').props('dense outlined')
            edge = ui.select(['nearest', 'first', 'last'], value='nearest', label='edge')
            edge.props('dense outlined')
            value = number('value', _DEFAULT_VALUES['kick'], '')
            fields = [number('duration', 0.1, 's', min=0)]
            fields += [number(label, 0.0, 's', min=0) for label in ('ramp up', 'ramp down')]

            kind.on_value_change(lambda: value.set_value(_DEFAULT_VALUES[kind.value]))
            for field in fields:
                field.bind_visibility_from(kind, 'value', lambda chosen: chosen != 'kick')

            async def send() -> str:
                instant = kind.value == 'kick'
                duration, up, down = (0.0 if instant else value_of(field) for field in fields)
                return await self._commands.drive(
                    kind.value, edge.value, value_of(value), (duration, up, down)
                )

            button('Send command', send, 'send', 'live-send')

    def _tilt(self) -> None:
        with self._group('Tilt of the chain', 'tilt'):
            slider = ui.slider(min=-_LARGEST_TILT, max=_LARGEST_TILT, step=0.005, value=0.0)
            slider.props('label aria-label="tilt [rad]" id=live-tilt').classes('live-slider')
            scale(slider, -_LARGEST_TILT, _LARGEST_TILT, 'rad')

            async def tilt() -> None:
                await attempt('Tilt', lambda: self._commands.tilt(float(slider.value)))

            slider.on('change', tilt, throttle=0.1)
            slider.on('update:model-value', tilt, throttle=0.1)
            self._slope = ui.label().classes('live-hint')

    def _move(self) -> None:
        with self._group('Move the soliton, and hold it there', 'move'):
            rotor = number('to rotor', 10.0, '', min=0).props('id=live-move-rotor')
            speed = number('speed, 0 = automatic', 0.0, 'rotors/s', min=0)

            async def move() -> str:
                model = self._view.chains[self._page.namespace].model
                position = model.numbers.get('rotor', math.nan)
                return await self._commands.move_to(value_of(rotor), value_of(speed), position)

            button('Move', move, 'moving', 'live-carry')
            self._cancel = button(
                'Cancel', lambda: self._commands.cancel(), 'cancel', 'live-cancel'
            )
            self._release = button(
                'Release', lambda: self._commands.release(), 'back_hand', 'live-release'
            )

    def refresh(self, why: Mapping[str, str]) -> None:
        """Disable the groups for which `why` contains a reason, and show the present tilt."""
        super().refresh(why)
        commands = self._view.commands(self._page.namespace)
        usable = not why['move']
        self._cancel.set_enabled(usable and commands.move.under_way)
        self._release.set_enabled(usable and (commands.holding or commands.move.held))
        gravity, tilt = gravity_of(self._view.finder, self._page.namespace)
        text = f'now {tilt:.3f} rad' if math.isfinite(tilt) else ''
        if gravity == 0:
            text += '; gravity is 0, so a tilt has no effect: set gravity.acceleration in Settings'
        self._slope.text = text


class RunControls(ChainControls):
    """Controls that pause, step and reset a simulation, and that set the real-time factor."""

    def __init__(self, view: View, page: Shown) -> None:
        super().__init__(view, page)
        self._pause()
        self._step()
        self._reset()
        self._factor()

    def _pause(self) -> None:
        with self._group('Simulation', 'pause'):
            button(
                'Pause', lambda: self._commands.pause(True), 'pause', 'live-pause', primary=True
            )
            button('Resume', lambda: self._commands.pause(False), 'play_arrow', 'live-resume')

    def _step(self) -> None:
        with self._group('Single steps of a paused simulation', 'step'):
            count = number('periods', 10, '', min=1, precision=0)
            button(
                'Step',
                lambda: self._commands.step(value_of(count)),
                'skip_next',
                'live-step',
                long=True,
            )

    def _reset(self) -> None:
        with self._group('Reset to a state', 'reset'):
            state = ui.select(list(STATES), value='initial', label='state').props('dense outlined')
            state.props('id=live-reset-state')
            position = number('position', 10.0, 'rotors')
            velocity = number('velocity', 0.0, 'm/s')
            angles = ui.input('angles [rad]', placeholder='rotor_0: 1.2, rotor_5: -0.5')
            angles.props('dense outlined').classes('live-wide')

            for field in (position, velocity):
                field.bind_visibility_from(state, 'value', value='soliton')
            angles.bind_visibility_from(state, 'value', value='angles')

            async def reset() -> str:
                if state.value == 'soliton':
                    return await self._commands.reset(
                        'soliton', value_of(position), value_of(velocity)
                    )
                joints = joint_angles(angles.value or '') if state.value == 'angles' else None
                return await self._commands.reset(state.value, joints=joints)

            button('Reset', reset, 'restart_alt', 'live-reset')

    def _factor(self) -> None:
        with self._group('Speed: simulated time per real time', 'pause'):
            offered = {
                factor: f'{factor:g} ×' if factor else 'as fast as possible' for factor in _FACTORS
            }
            factor = ui.select(offered, label='new real-time factor')
            factor.props('dense outlined id=live-factor').classes('live-wide')

            async def change() -> str:
                if factor.value is None:
                    raise ValueError('no real-time factor is selected; select one first')
                return await self._set_in_simulator('real_time_factor', factor)

            button('Set', change, 'speed', 'live-pace')


def joint_angles(text: str) -> dict[str, float]:
    """Return the angle of each joint [rad] from a text such as 'rotor_0: 1.2, rotor_1: 1.5'.

    Raises ValueError if the text has another form.
    """
    angles = {}
    for part in filter(None, (p.strip() for p in text.split(','))):
        name, _, value = part.partition(':')
        try:
            angles[name.strip()] = float(value)
        except ValueError as error:
            raise ValueError(f'{part!r} is not a joint and its angle; {_EXAMPLE}') from error
    if not angles:
        raise ValueError(f'the list of angles is empty; {_EXAMPLE}')
    return angles


def reasons_for(view: View, namespace: str) -> dict[str, str]:
    """Return why each control of a chain is disabled. The text is '' for an enabled control."""
    missing = 'this chain is no longer published' if namespace else 'select one chain'
    return view.reasons.get(namespace) or dict.fromkeys(CONTROLS, missing)
