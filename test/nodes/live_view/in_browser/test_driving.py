# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from programs import until

from soliton_linkage.linear.bands import band_edges
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.runtime import interfaces


def test_a_nudge_is_sent_by_button_and_key(at_rest, stage):
    visit = at_rest
    nudges, commands = stage.record(interfaces.NUDGE), stage.record(interfaces.EDGE_COMMAND)
    kicks = stage.record(interfaces.LAST_KICK)
    visit.fill('speed', 3)
    visit.click('nudge')
    until(lambda: nudges, 'the nudge')
    assert nudges[0].data == 3.0
    until(lambda: kicks, 'the kick of the actuator')
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('n')
    until(lambda: commands, 'the key')
    assert (commands[-1].kind, commands[-1].edge) == (EdgeCommand.KICK, EdgeCommand.NEAREST)
    assert commands[-1].value == 3.0


@pytest.mark.parametrize('by', ['pointer', 'key'])
def test_a_rotor_follows_the_pull_until_it_is_released(at_rest, view, stage, by):
    visit, model = at_rest, view.chains['/'].model
    kicks = stage.record(interfaces.LAST_KICK)
    torques = stage.record(interfaces.ROTOR_TORQUES)
    rotor = 5
    before = float(model.angles[rotor])
    if by == 'pointer':
        x, y = visit.mass(rotor)
        visit.page.mouse.move(x, y)
        visit.page.mouse.down()
        visit.page.mouse.move(x + 30, y - 10, steps=3)
    else:
        visit.js(f'live.view.mark = {rotor}')
        visit.page.focus('#live-chain')
        visit.page.keyboard.down('ArrowDown')
    until(lambda: model.angles[rotor] > before + 0.05, 'the rotor to follow')
    assert max(abs(torque) for message in torques for torque in message.effort) < 0.02
    if by == 'pointer':
        visit.page.mouse.up()
    else:
        visit.page.keyboard.up('ArrowDown')
    visit.tells_effect('torques on rotor_5 for ')
    until(lambda: kicks, 'the report of the torques')
    assert kicks[-1].source.endswith('joint_commands')
    until(lambda: not any(torques[-1].effort), 'the end of the torques')


def test_a_rejected_nudge_is_shown_with_the_reason_of_the_actuator(at_rest, view, stage):
    visit = at_rest
    kicks = stage.record(interfaces.LAST_KICK)
    visit.fill('speed', 1000)
    visit.click('nudge')
    visit.answers('edge_actuator rejected the command: ')
    figures = view.finder.reports['/edge_actuator'][1].figures
    assert figures['last rejection'].removeprefix('/nudge: ') in visit.js('live.answers.text')
    assert not kicks
    visit.fill('speed', 3)
    visit.click('nudge')
    visit.tells_effect('a kick of 3 rad/s at the ')
    until(lambda: kicks, 'the kick')
    assert kicks[-1].command.value == 3.0
    assert '1000' not in visit.text('answer')


def test_an_answer_that_is_late_is_reported_after_two_seconds(visit, stage):
    shown = "live.answers.show({id: 'late', name: 'Nudge', good: null}), live.answers.text"
    assert visit.js(f'({shown})') == '… Nudge: waiting for the answer'
    visit.has_text('answer', 'Nudge: no answer within 2 s, still waiting')
    visit.js("live.answers.show({id: 'late', answer: 'done', good: true})")
    visit.has_text('answer', 'Nudge: done')


def test_a_sine_burst_is_sent_from_the_slider_with_the_phonon_band(at_rest, view, stage):
    visit = at_rest
    received, kicks = stage.record(interfaces.EDGE_COMMAND), stage.record(interfaces.LAST_KICK)
    visit.tab('Drive')
    low, high = band_edges(view.chains['/'].model.named.chain)
    visit.has_text('band', f'Phonon band, shaded: {low:.3g} to {high:.3g} rad/s')
    assert 'linear-gradient' in visit.js(
        'document.getElementById("live-frequency").style.background'
    )
    before = float(visit.field('frequency').input_value())
    frequency = before + 0.5
    visit.slide('frequency', frequency)
    visit.has_value('frequency', f'{frequency:g}')
    assert low < frequency < high
    visit.fill('cycles', 3)
    visit.click('wave')
    until(lambda: received, 'the waveform')
    sent = received[0]
    assert (sent.kind, sent.shape) == (EdgeCommand.WAVEFORM, EdgeCommand.BURST)
    assert (sent.edge, sent.quantity) == (EdgeCommand.FIRST, EdgeCommand.TORQUE)
    assert (sent.frequency, sent.cycles) == (pytest.approx(frequency), 3.0)
    until(lambda: kicks, 'the report of the burst')
    assert kicks[-1].command.kind == EdgeCommand.WAVEFORM
    assert kicks[-1].peak_torque == pytest.approx(0.002, rel=0.2)
    visit.tells_effect('rotor_0')


def test_the_slider_changes_the_motors_of_the_running_simulator(at_rest, view):
    visit, model = at_rest, view.chains['/'].model
    visit.tab('Drive')
    visit.slide('coupling', 1e-5, lambda: model.named.chain.non_reciprocity > 0)
    kappa = model.named.chain.non_reciprocity
    visit.has_text('motors', f'κ = {kappa:.3g} N m/rad')
    visit.slide('coupling', 0, lambda: model.named.chain.non_reciprocity == 0)


def test_edge_commands_are_sent_with_their_times(visit, stage):
    received = stage.record(interfaces.EDGE_COMMAND)
    visit.tab('Drive')
    visit.click('send')
    until(lambda: received, 'the kick')
    kick = received[0]
    assert (kick.kind, kick.value, kick.duration) == (EdgeCommand.KICK, 10.0, 0.0)
    visit.choose('kind', 'pulse [N m]')
    visit.has_value('value', '0.002')
    visit.fill('value', 0.001)
    visit.fill('duration', 0.2)
    visit.fill('ramp up', 0.05)
    visit.fill('ramp down', 0.1)
    visit.click('send')
    until(lambda: len(received) > 1, 'the pulse')
    pulse = received[1]
    assert (pulse.kind, pulse.edge) == (EdgeCommand.PULSE, EdgeCommand.NEAREST)
    numbers = (pulse.value, pulse.duration, pulse.ramp_up, pulse.ramp_down)
    assert numbers == (0.001, 0.2, 0.05, 0.1)
    visit.choose('kind', 'pressure [Pa]')
    visit.has_value('value', '20000')
    visit.choose('edge', 'last')
    visit.fill('value', -5000)
    visit.click('send')
    until(lambda: len(received) > 2, 'the pressure')
    pressure = received[2]
    assert (pressure.kind, pressure.edge) == (EdgeCommand.PRESSURE, EdgeCommand.LAST)
    assert pressure.value == -5000
    visit.choose('kind', 'kick [rad/s]')
    visit.choose('edge', 'nearest')


def test_the_slider_tilts_the_chain(visit, view, stage):
    received = stage.record(interfaces.TILT)
    visit.tab('Drive')
    for angle in (0.005, 0.01, 0.005, 0.0):
        visit.slide(
            'tilt', angle, lambda a=angle: received and received[-1].data == pytest.approx(a)
        )
        visit.panel_has_text(f'now {angle:.3f} rad')


def test_the_simulation_is_paused_stepped_and_resumed_and_its_factor_is_set(visit, stage):
    subscription = stage.subscribe(interfaces.JOINT_STATES)
    received = stage.record(interfaces.JOINT_STATES)
    until(lambda: received, 'joint_states')
    visit.tab('Run')
    visit.click('pause')
    visit.has_text('stale', 'paused, no joint_states for')
    visit.wait('!document.getElementById("live-health").textContent')
    before = len(received)
    visit.fill('periods', 7)
    visit.click('step')
    until(lambda: len(received) == before + 7, 'seven frames')
    visit.click('resume')
    until(lambda: len(received) > before + 20, 'further frames')
    stage.user.destroy_subscription(subscription)
    visit.wait('document.getElementById("live-stale").hidden')
    visit.click('pace')
    visit.answers('no real-time factor is selected')
    visit.choose('real-time factor', '0.5 ×')
    visit.click('pace')
    visit.answers('real_time_factor = 0.5')
    visit.choose('real-time factor', '1 ×')
    visit.click('pace')
    visit.answers('real_time_factor = 1.0')


@pytest.mark.parametrize('state', ['left-leaning', 'right-leaning', 'soliton', 'initial'])
def test_the_chain_is_reset_to_each_state(visit, view, state):
    visit.tab('Run')
    visit.choose('state', state)
    if state == 'soliton':
        visit.fill('position', 8.5)
        visit.fill('velocity', 0)
    visit.click('reset')
    model = view.chains['/'].model
    if state in ('soliton', 'initial'):
        position = 8.5 if state == 'soliton' else 5.5
        until(lambda: abs(model.numbers.get('rotor', math.nan) - position) < 0.1, 'the soliton')
    else:
        sign = -1 if state == 'left-leaning' else 1
        lean = sign * math.sin(model.named.chain.rest_angle)
        until(lambda: np.allclose(np.sin(model.angles), lean, atol=1e-3), 'the state')


def test_the_chain_is_reset_to_angles_and_invalid_angles_are_rejected(visit, stage):
    visit.tab('Run')
    visit.choose('state', 'angles')
    visit.fill('angles [rad]', 'rotor_0: x')
    visit.click('reset')
    visit.answers('write joint and angle')
    visit.fill('angles [rad]', 'rotor_99: 1.0')
    visit.click('reset')
    visit.answers("'rotor_99', which is none of 'rotor_0' to 'rotor_11'")
    subscription = stage.subscribe(interfaces.JOINT_STATES)
    received = stage.record(interfaces.JOINT_STATES)
    until(lambda: received, 'frames')
    visit.fill('angles [rad]', 'rotor_0: 1.25, rotor_11: -0.5')
    visit.click('reset')
    until(
        lambda: any(abs(frame.position[0] - 1.25) < 1e-3 for frame in list(received)), 'the angles'
    )
    stage.user.destroy_subscription(subscription)
    visit.choose('state', 'initial')


def test_parameters_are_shown_with_range_and_unit_and_changed(visit, view):
    visit.tab('Settings')
    visit.choose('node', 'simulator')
    visit.panel_has_text('acceleration of a free mass [m/s^2]; 0 ')
    visit.fill('gravity.acceleration', 0.5)
    until(
        lambda: view.finder.reports['/simulator'][1].figures['gravity [m/s^2]'] == '0.5',
        'the gravity',
    )
    visit.fill('gravity.acceleration', -1)
    visit.answers('gravity.acceleration = -1.0 must lie in the range 0 to')
    visit.has_value('gravity.acceleration', '0.5')
    assert 'must lie in the range 0 to' in visit.text('answer')
    visit.fill('gravity.acceleration', 0)
    visit.answers('gravity.acceleration = 0.0')


def test_the_keyboard_reaches_all_controls(visit, stage):
    received = stage.record(interfaces.NUDGE)
    visit.tab('Drive')
    visit.page.focus('#live-dark')
    reached = []
    while 'live-send' not in reached and len(reached) < 40:
        visit.page.keyboard.press('Tab')
        reached.append(visit.js('document.activeElement.id'))
        if reached[-1] == 'live-nudge':
            visit.page.keyboard.press('Enter')
    order = [name for name in reached if name in ('live-nudge', 'live-send', 'live-carry')]
    assert order == ['live-nudge', 'live-carry', 'live-send']
    until(lambda: received, 'the nudge')
