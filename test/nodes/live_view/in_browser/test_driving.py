# SPDX-License-Identifier: Apache-2.0
"""Every control that drives a chain or its simulation changes what the graph hears."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from live_stage import Stage, Visit, until

from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.runtime import interfaces


def test_nudge_by_button_by_drag_and_by_key(at_rest: Visit, stage: Stage) -> None:
    visit = at_rest
    nudges, commands = stage.hear(interfaces.NUDGE), stage.hear(interfaces.EDGE_COMMAND)
    kicks = stage.hear(interfaces.LAST_KICK)
    visit.fill('strength', 3)
    visit.click('nudge')
    until(lambda: nudges, 'the nudge')
    assert nudges[0].data == 3.0
    until(lambda: kicks, 'what the actuator makes of it')

    def drag() -> None:
        x, y = visit.mass(0)
        visit.page.mouse.move(x, y)
        visit.page.mouse.down()
        visit.page.mouse.move(x + 30, y - 25, steps=4)
        visit.page.mouse.up()

    # The mass may have gone on, or the page have moved under it.
    until(lambda: drag() or commands, 'the drag')
    assert commands[0].kind == EdgeCommand.KICK
    assert commands[0].edge == EdgeCommand.FIRST
    assert 0 < abs(commands[0].value) <= 15
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('n')
    until(lambda: commands[-1].edge == EdgeCommand.NEAREST, 'the key')
    assert commands[-1].value == 3.0


def test_kick_pulse_and_pressure_with_their_times(visit: Visit, stage: Stage) -> None:
    heard = stage.hear(interfaces.EDGE_COMMAND)
    visit.tab('Drive')
    visit.click('send')
    until(lambda: heard, 'the kick')
    kick = heard[0]
    assert (kick.kind, kick.value, kick.duration) == (EdgeCommand.KICK, 10.0, 0.0)
    visit.choose('kind', 'pulse [N m]')
    visit.shows('value', '0.002')
    visit.fill('value', 0.001)
    visit.fill('duration', 0.2)
    visit.fill('ramp up', 0.05)
    visit.fill('ramp down', 0.1)
    visit.click('send')
    until(lambda: len(heard) > 1, 'the pulse')
    pulse = heard[1]
    assert (pulse.kind, pulse.edge) == (EdgeCommand.PULSE, EdgeCommand.NEAREST)
    told = (pulse.value, pulse.duration, pulse.ramp_up, pulse.ramp_down)
    assert told == (0.001, 0.2, 0.05, 0.1)
    visit.choose('kind', 'pressure [Pa]')
    visit.shows('value', '20000')
    visit.choose('edge', 'last')
    visit.fill('value', -5000)
    visit.click('send')
    until(lambda: len(heard) > 2, 'the pressure')
    pressure = heard[2]
    assert (pressure.kind, pressure.edge) == (EdgeCommand.PRESSURE, EdgeCommand.LAST)
    assert pressure.value == -5000
    visit.choose('kind', 'kick [rad/s]')
    visit.choose('edge', 'nearest')


def test_tilt_by_its_slider(visit: Visit, view: Any, stage: Stage) -> None:
    heard = stage.hear(interfaces.TILT)
    visit.tab('Drive')
    slider = visit.page.locator('#live-tilt [tabindex="0"]')
    slider.press('ArrowRight')
    until(lambda: heard and heard[-1].data == pytest.approx(0.005), 'the first step')
    slider.press('ArrowRight')
    until(lambda: heard[-1].data == pytest.approx(0.01), 'the tilt')
    visit.panel_says('now 0.010 rad')
    slider.press('ArrowLeft')
    until(lambda: heard[-1].data == pytest.approx(0.005), 'a step back')
    slider.press('ArrowLeft')
    until(lambda: heard[-1].data == pytest.approx(0.0), 'the tilt back')


def test_pause_step_go_on_and_pace(visit: Visit, view: Any, stage: Stage) -> None:
    listening = stage.listen(interfaces.JOINT_STATES)
    heard = stage.hear(interfaces.JOINT_STATES)
    until(lambda: heard, 'joint_states')
    visit.tab('Run')
    visit.click('pause')
    visit.says('stale', 'paused, no joint_states since')
    visit.shot('paused')
    before = len(heard)
    visit.fill('periods', 7)
    visit.click('step')
    until(lambda: len(heard) == before + 7, 'seven frames')
    visit.click('resume')
    until(lambda: len(heard) > before + 20, 'time to go on')
    stage.user.destroy_subscription(listening)
    visit.wait('document.getElementById("live-stale").hidden')
    visit.choose('real-time factor', '0.5 ×')
    visit.click('pace')
    figures = view.finder.reports
    until(
        lambda: 0.3 < float(figures['/simulator'][1].figures['real-time factor']) < 0.7,
        'half pace',
    )
    visit.choose('real-time factor', '1 ×')
    visit.click('pace')
    visit.told('real_time_factor = 1.0')


@pytest.mark.parametrize('state', ['left-leaning', 'right-leaning', 'soliton', 'initial'])
def test_reset_to_each_kind_of_state(visit: Visit, view: Any, state: str) -> None:
    visit.tab('Run')
    visit.choose('state', state)
    if state == 'soliton':
        visit.fill('place', 8.5)
        visit.fill('velocity', 0)
    visit.click('reset')
    model = view.finder.chains['/'].model
    if state in ('soliton', 'initial'):
        place = 8.5 if state == 'soliton' else 5.5
        until(lambda: abs(model.numbers.get('rotor', math.nan) - place) < 0.1, 'the soliton')
    else:
        sign = -1 if state == 'left-leaning' else 1
        lean = sign * math.sin(model.named.chain.rest_angle)
        until(lambda: np.allclose(np.sin(model.angles), lean, atol=1e-3), 'the state')


def test_reset_to_angles_and_refuse_what_is_none(visit: Visit, stage: Stage) -> None:
    visit.tab('Run')
    visit.choose('state', 'angles')
    visit.fill('angles [rad]', 'rotor_0: x')
    visit.click('reset')
    visit.told('write joint and angle')
    visit.fill('angles [rad]', 'rotor_99: 1.0')
    visit.click('reset')
    visit.told("'rotor_99', which is none of 'rotor_0' to 'rotor_11'")
    listening = stage.listen(interfaces.JOINT_STATES)
    heard = stage.hear(interfaces.JOINT_STATES)
    until(lambda: heard, 'frames')
    visit.fill('angles [rad]', 'rotor_0: 1.25, rotor_11: -0.5')
    visit.click('reset')
    until(lambda: any(abs(frame.position[0] - 1.25) < 1e-3 for frame in list(heard)), 'the angles')
    stage.user.destroy_subscription(listening)
    visit.choose('state', 'initial')


def test_parameters_with_ranges_and_units(visit: Visit, view: Any) -> None:
    visit.tab('Settings')
    visit.choose('node', 'simulator')
    visit.panel_says('acceleration of a free mass [m/s^2]; from 0')
    visit.shot('settings')
    visit.fill('gravity.acceleration', 0.5)
    until(
        lambda: view.finder.reports['/simulator'][1].figures['gravity [m/s^2]'] == '0.5',
        'the gravity',
    )
    visit.fill('gravity.acceleration', -1)
    visit.told('gravity.acceleration')
    visit.shows('gravity.acceleration', '0.5')
    visit.fill('gravity.acceleration', 0)
    visit.told('gravity.acceleration = 0.0')


def test_all_controls_are_reached_by_the_keyboard(visit: Visit, stage: Stage) -> None:
    heard = stage.hear(interfaces.NUDGE)
    visit.tab('Drive')
    visit.page.focus('#live-dark')
    reached = []
    while 'live-carry' not in reached and len(reached) < 40:
        visit.page.keyboard.press('Tab')
        reached.append(visit.js('document.activeElement.id'))
        if reached[-1] == 'live-nudge':
            visit.page.keyboard.press('Enter')
    order = [name for name in reached if name in ('live-nudge', 'live-send', 'live-carry')]
    assert order == ['live-nudge', 'live-send', 'live-carry']
    until(lambda: heard, 'the nudge')
