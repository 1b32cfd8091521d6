# SPDX-License-Identifier: Apache-2.0
"""The page as people use it, in a browser, with the nodes of the suite behind it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_stage import Rig, Stage, Visit, until

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.live_view.node import LiveView
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

pytest.importorskip('nicegui', reason='NiceGUI is not installed')

ROTORS, PLACE = 12, 5.5
SIMULATED = {
    'chain.number_of_rotors': ROTORS,
    'publish_rate': 100.0,
    'initial_state': 'soliton',
    'initial_place': PLACE,
}
BAGS = Path(__file__).parents[3] / 'bags'


@pytest.fixture(scope='module')
def view(stage: Stage) -> Any:
    stage.start(Simulator, SIMULATED)
    for node in (EdgeActuator, SolitonAnalyser, SolitonSteering):
        stage.start(node)
    folders = [str(stage.folder / 'bags'), str(BAGS)]
    made = stage.start(LiveView, {'port': 0, 'bag_folders': folders, 'frame_rate': 10.0})
    chain = made.finder.chains['/'].model
    until(lambda: chain.numbers.get('walls') == 1, 'the soliton')
    until(lambda: made.commands('/').listeners('nudge'), 'the actuator')
    return made


@pytest.fixture(scope='module')
def open_page(browser: Any, view: Any) -> Iterator[Callable[..., Visit]]:
    visits: list[Visit] = []

    def visit(**options: Any) -> Visit:
        visits.append(Visit(browser, view.address, **options))
        return visits[-1]

    yield visit
    for each in visits:
        each.close()


@pytest.fixture(scope='module')
def shared(open_page: Callable[..., Visit]) -> Visit:
    return open_page()


@pytest.fixture
def visit(shared: Visit, view: Any) -> Iterator[Visit]:
    """The page of all tests, with the chain at rest and its soliton in its place."""
    shared.page.bring_to_front()
    shared.js('live.view.all()')
    yield shared
    console, shared.console = shared.console, []
    assert console == []


@pytest.fixture
def at_rest(view: Any, visit: Visit) -> Visit:
    """The same, after a reset."""
    visit.tab('Run')
    visit.choose('state', 'initial')
    visit.click('reset')
    model = view.finder.chains['/'].model
    until(lambda: abs(model.numbers.get('rotor', math.nan) - PLACE) < 0.1, 'the reset')
    visit.tab('Drive')
    return visit


def steering_sees_it(view: Any) -> None:
    """Wait until the steering has seen where the soliton is after a reset."""
    reports = view.finder.reports
    reports.pop('/soliton_steering', None)
    until(
        lambda: (
            '/soliton_steering' in reports
            and abs(float(reports['/soliton_steering'][1].figures['rotor']) - PLACE) < 0.1
        ),
        'the steering to see the soliton',
    )


def test_every_panel_shows_what_was_published(at_rest: Visit, view: Any) -> None:
    visit = at_rest
    model = view.finder.chains['/'].model
    visit.wait(f'Math.abs(live.shown.rotor - {PLACE}) < 0.1 && live.shown.age < 0.5')
    shown = visit.js('({...live.shown, angles: [...live.shown.angles]})')
    np.testing.assert_allclose(shown['angles'], model.angles, atol=1e-4)
    assert shown['rotors'] == ROTORS
    assert shown['charge'] == 1
    assert (shown['winding_before'], shown['winding_beyond']) == (0, 1)
    visit.wait('document.getElementById("live-chain-note").textContent.includes("rotor 5.5")')
    assert 'flipper · 12 rotors · soliton at rotor 5.5' in visit.text('chain-note')
    assert 'charge 1, zero mode at 5.5' in visit.text('topology-note')
    assert 'wall at 5.5' in visit.text('lean-note')
    for canvas in ('chain', 'lean', 'kymograph', 'dial', 'energy', 'topology'):
        assert visit.painted(canvas) > 5, canvas
    column = visit.js(
        """(() => { const t = live.track(0); const at = t.at(t.newest);
        return [...t.image.subarray(at * t.height, (at + 1) * t.height)]; })()"""
    )
    lean = view.finder.chains['/'].model.named.chain.positions(model.angles)[0]
    np.testing.assert_allclose(column, lean, atol=1e-4)
    assert 'Hz' in visit.text('health')
    assert not visit.page.locator('#live-stale').is_visible()
    visit.shot('chain_light')


def test_nudge_by_button_by_drag_and_by_key(at_rest: Visit, stage: Stage) -> None:
    visit = at_rest
    nudges, commands = stage.hear(interfaces.NUDGE), stage.hear(interfaces.EDGE_COMMAND)
    impulses = stage.hear(interfaces.ROTOR_IMPULSES)
    visit.fill('strength', 3)
    visit.click('nudge')
    until(lambda: nudges, 'the nudge')
    assert nudges[0].data == 3.0
    until(lambda: impulses, 'what the actuator makes of it')
    points = visit.js('live.view.places()')
    box = visit.page.locator('#live-chain').bounding_box()
    x, y = box['x'] + points[0][1], box['y'] + points[0][2]
    visit.page.mouse.move(x, y)
    visit.page.mouse.down()
    visit.page.mouse.move(x + 30, y - 25, steps=4)
    visit.page.mouse.up()
    until(lambda: commands, 'the drag')
    assert commands[0].kind == EdgeCommand.KICK
    assert commands[0].edge == EdgeCommand.FIRST
    assert 0 < abs(commands[0].value) <= 15
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('n')
    until(lambda: len(commands) > 1, 'the key')
    assert (commands[1].edge, commands[1].value) == (EdgeCommand.NEAREST, 3.0)


def test_pulse_and_pressure_with_their_times(visit: Visit, stage: Stage) -> None:
    heard = stage.hear(interfaces.EDGE_COMMAND)
    visit.tab('Drive')
    visit.choose('kind', 'pulse [N m]')
    visit.fill('value', 0.001)
    visit.fill('duration', 0.2)
    visit.fill('ramp up', 0.05)
    visit.fill('ramp down', 0.1)
    visit.click('send')
    until(lambda: heard, 'the pulse')
    pulse = heard[0]
    assert (pulse.kind, pulse.edge) == (EdgeCommand.PULSE, EdgeCommand.NEAREST)
    told = (pulse.value, pulse.duration, pulse.ramp_up, pulse.ramp_down)
    assert told == (0.001, 0.2, 0.05, 0.1)
    visit.choose('kind', 'pressure [Pa]')
    visit.choose('edge', 'last')
    visit.fill('value', -5000)
    visit.click('send')
    until(lambda: len(heard) > 1, 'the pressure')
    pressure = heard[1]
    assert (pressure.kind, pressure.edge) == (EdgeCommand.PRESSURE, EdgeCommand.LAST)
    assert pressure.value == -5000
    visit.choose('kind', 'kick [rad/s]')
    visit.choose('edge', 'nearest')


def test_tilt_by_its_slider(visit: Visit, stage: Stage) -> None:
    heard = stage.hear(interfaces.TILT)
    visit.tab('Drive')
    slider = visit.page.locator('#live-tilt [tabindex="0"]')
    slider.press('ArrowRight')
    slider.press('ArrowRight')
    until(lambda: heard and heard[-1].data == pytest.approx(0.01), 'the tilt')
    slider.press('ArrowLeft')
    slider.press('ArrowLeft')
    until(lambda: heard[-1].data == pytest.approx(0.0), 'the tilt back')


def test_pause_step_go_on_and_pace(visit: Visit, view: Any, stage: Stage) -> None:
    heard = stage.hear(interfaces.JOINT_STATES)
    visit.tab('Run')
    visit.click('pause')
    visit.wait('document.getElementById("live-stale").textContent.startsWith("paused, no joint")')
    visit.shot('paused')
    before = len(heard)
    visit.fill('periods', 7)
    visit.click('step')
    until(lambda: len(heard) == before + 7, 'seven frames')
    visit.click('resume')
    until(lambda: len(heard) > before + 20, 'time to go on')
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


@pytest.mark.parametrize(
    ('state', 'wall'), [('left-leaning', False), ('right-leaning', False), ('soliton', True)]
)
def test_reset_to_each_kind_of_state(visit: Visit, view: Any, state: str, wall: bool) -> None:
    visit.tab('Run')
    visit.choose('state', state)
    if wall:
        visit.fill('place', 8.5)
    visit.click('reset')
    model = view.finder.chains['/'].model
    if wall:
        until(lambda: abs(model.numbers.get('rotor', math.nan) - 8.5) < 0.1, 'the soliton there')
    else:
        sign = -1 if state == 'left-leaning' else 1
        lean = sign * math.sin(model.named.chain.rest_angle)
        until(lambda: np.allclose(np.sin(model.angles), lean, atol=1e-3), 'the state')


def test_reset_to_angles_and_refuse_what_is_none(visit: Visit, view: Any) -> None:
    visit.tab('Run')
    visit.choose('state', 'angles')
    visit.fill('angles [rad]', 'rotor_0: x')
    visit.click('reset')
    visit.page.get_by_text('write joint and angle').first.wait_for()
    visit.fill('angles [rad]', 'rotor_99: 1.0')
    visit.click('reset')
    visit.page.get_by_text("'rotor_99', which is none of 'rotor_0' to 'rotor_11'").first.wait_for()


def test_parameters_with_ranges_and_units(visit: Visit, view: Any) -> None:
    visit.tab('Settings')
    visit.choose('node', 'simulator')
    visit.page.get_by_text('acceleration of a free mass [m/s^2]; from 0').wait_for()
    visit.shot('settings')
    visit.fill('gravity.acceleration', 0.5)
    until(
        lambda: view.finder.reports['/simulator'][1].figures['gravity [m/s^2]'] == '0.5',
        'the gravity',
    )
    visit.fill('gravity.acceleration', -1)
    visit.page.locator('.q-notification:has-text("gravity.acceleration")').first.wait_for()
    until(
        lambda: visit.page.get_by_label('gravity.acceleration').input_value() == '0.5',
        'the field to show what holds',
    )
    visit.fill('gravity.acceleration', 0)


def test_a_click_carries_the_soliton_there_and_it_is_let_go(at_rest: Visit, view: Any) -> None:
    visit = at_rest
    steering_sees_it(view)
    visit.page.mouse.click(*visit.place(7.0))
    visit.page.locator('#live-move progress').wait_for()
    assert visit.js('live.shown.goal') == pytest.approx(7.0, abs=0.06)
    visit.shot('move')
    visit.page.reload()
    visit.wait('window.live && live.drawn > 5')
    move = view.commands('/').move
    visit.wait('document.getElementById("live-move").textContent.includes("rotor 7.0")')
    until(lambda: not move.under_way, 'the end of the move')
    assert move.state == 'reached'
    visit.wait('document.getElementById("live-move").textContent.startsWith("reached")')
    visit.click('release')
    visit.page.get_by_text('let go').first.wait_for()


def test_a_move_is_cancelled_and_one_out_of_the_chain_is_told_in_words(
    at_rest: Visit, view: Any
) -> None:
    visit = at_rest
    steering_sees_it(view)
    visit.page.focus('#live-chain')
    for _ in range(3):
        visit.page.keyboard.press('ArrowRight')
    visit.page.keyboard.press('Enter')
    until(lambda: view.commands('/').move.under_way, 'the move')
    visit.click('cancel')
    until(lambda: view.commands('/').move.state == 'cancelled', 'the cancellation')
    visit.wait('document.getElementById("live-move").textContent.startsWith("cancelled")')
    visit.fill('to rotor', 40)
    visit.click('carry')
    visit.wait('document.getElementById("live-move").textContent.startsWith("out of the chain")')
    visit.click('release')
    visit.page.keyboard.press('Escape')


def test_zoom_pan_and_all(visit: Visit) -> None:
    visit.page.mouse.move(*visit.place(6.0))
    visit.page.mouse.wheel(0, -300)
    visit.wait('live.view.last - live.view.first < 11')
    visit.wait('live.shown.angles.length <= live.shown.rotors')
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('+')
    visit.page.keyboard.press('PageDown')
    visit.page.keyboard.press('0')
    assert visit.js('live.view.last - live.view.first') == pytest.approx(
        ROTORS - 1 + 2 * visit.js('live.view.margin')
    )


def test_a_source_that_stops_comes_back_and_changes_its_rotors(
    visit: Visit, view: Any, stage: Stage
) -> None:
    rig = Rig(stage, '/rig/')
    until(lambda: '/rig/' in view.finder.chains, 'the chain to be found')
    model = view.finder.chains['/rig/'].model
    until(lambda: rig.publish(6) or model.frames, 'a frame')
    visit.choose('chain', 'rig')
    visit.wait('live.watched === "/rig/" && live.shown && live.shown.rotors === 6')
    assert 'no chain' in visit.js('live.view.note()')
    visit.wait(
        '/^no joint_states since [1-9]/.test(document.getElementById("live-stale").textContent)'
    )
    assert visit.page.locator('#live-stale').evaluate(
        'e => getComputedStyle(e).backgroundColor'
    ) == ('rgb(176, 0, 32)')
    assert 'paused' not in (visit.page.locator('#live-stale').get_attribute('class') or '')
    visit.shot('stopped')
    visit.tab('Run')
    visit.panel_says('only a simulator does that')
    assert visit.page.locator('#live-pause').is_disabled()
    visit.tab('Drive')
    visit.panel_says('nothing subscribes to nudge')
    before = model.frames
    until(lambda: rig.publish(9) or model.frames > before, 'another frame')
    visit.wait('live.shown.rotors === 9')
    visit.wait('document.getElementById("live-stale").hidden')
    visit.choose('chain', 'all side by side')
    visit.wait('document.querySelectorAll(".live-tile").length === 2')
    visit.page.wait_for_timeout(300)
    visit.shot('side_by_side')
    visit.page.locator('.live-tile[data-chain="/"]').click()
    visit.wait('live.watched === "/" && live.shown.rotors === 12')


def test_ten_thousand_rotors_are_shown_in_groups(visit: Visit, view: Any, stage: Stage) -> None:
    rig = Rig(stage, '/long/')
    until(lambda: '/long/' in view.finder.chains, 'the chain to be found')
    model = view.finder.chains['/long/'].model
    until(lambda: rig.publish(10_000) or model.frames, 'a frame')
    visit.choose('chain', 'long')
    visit.wait('live.shown.rotors === 10000 && live.shown.overview.length === 2048')
    visit.page.wait_for_timeout(200)
    visit.shot('ten_thousand')
    assert visit.painted('chain') > 3
    visit.js('live.view.move(5000, 5050)')
    until(
        lambda: rig.publish(10_000) or visit.js('live.shown.angles.length') in range(40, 70),
        'a part',
    )
    visit.choose('chain', 'chain')
    visit.wait('live.shown.rotors === 12')
    stage.user.destroy_publisher(rig.joints)


def test_a_recording_is_made_split_and_finished(visit: Visit, view: Any) -> None:
    visit.tab('Bags')
    visit.click('record')
    until(lambda: view.recording.report, 'the recorder')
    visit.wait(
        'document.getElementById("live-health").textContent.includes("● recorder: recording")'
    )
    visit.page.wait_for_timeout(400)
    for name in ('record-pause', 'record-resume', 'record-split'):
        visit.page.locator(f'#live-{name}:enabled').click()
    visit.page.locator('#live-record-snapshot').click()
    visit.page.get_by_text('snapshot_duration of bag_recorder = 0').first.wait_for()
    visit.shot('recording')
    visit.click('record-stop')
    visit.page.get_by_text('the bag is finished').first.wait_for()
    (bag,) = [bag for bag in view.shelf.bags() if bag.name.startswith('recording_')]
    assert bag.lost == 0
    assert bag.topics['/joint_states'] > 10


def test_a_bag_is_played_beside_the_chain_and_sought(visit: Visit, view: Any) -> None:
    visit.tab('Bags')
    visit.click('bags-look')
    visit.page.locator('.live-bag:has-text("flipper_0")').get_by_role('button').click()
    visit.wait('live.watched.startsWith("/replay/")')
    visit.wait('live.shown && live.shown.rotors > 2 && live.status.replay.position > 0.2')
    visit.wait(
        '!document.getElementById("live-time-figure").hidden && live.time.track.length > 50'
    )
    assert 'of flipper_0' in visit.text('time-note')
    visit.page.wait_for_timeout(500)
    visit.shot('replay')
    visit.click('replay-pause')
    until(lambda: view.replay.paused, 'the pause')
    box = visit.page.locator('#live-time').bounding_box()
    visit.page.mouse.click(box['x'] + 10 + 0.5 * (box['width'] - 20), box['y'] + 30)
    visit.click('replay-play')
    half = view.replay.bag.duration / 2
    until(lambda: abs(view.replay.position - half) < 3, 'the middle of the bag')
    visit.page.focus('#live-time')
    visit.page.keyboard.press('PageDown')
    until(lambda: view.replay.position < half - 1, 'an earlier place')
    visit.choose('rate', '5 ×')
    until(lambda: view.replay.rate == 5.0, 'the rate')
    visit.tab('Drive')
    visit.panel_says('this is a replay')
    visit.tab('Bags')
    visit.click('replay-end')
    visit.wait('live.watched === "/" && live.shown.rotors === 12')


def test_two_browsers_see_the_same_and_choose_for_themselves(
    visit: Visit, open_page: Callable[..., Visit], view: Any
) -> None:
    other = open_page()
    assert view.streams == 2
    other.choose('chain', 'rig')
    other.wait('live.watched === "/rig/"')
    assert visit.js('live.watched') == '/'
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')
    other.close()
    until(lambda: view.streams == 1, 'the other to be gone')
    assert other.console == []


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_a_phone_shows_all_of_it_one_below_the_other(
    open_page: Callable[..., Visit], scheme: str
) -> None:
    visit = open_page(color_scheme=scheme, has_touch=True)
    visit.page.set_viewport_size({'width': 390, 'height': 844})
    visit.page.wait_for_timeout(600)
    assert visit.js('document.documentElement.scrollWidth') == 390
    above = visit.page.locator('#live-nudge').bounding_box()['y']
    assert above < visit.page.locator('#live-lean').bounding_box()['y']
    for name in ('chain', 'lean', 'kymograph', 'dial', 'energy', 'topology'):
        box = visit.page.locator(f'#live-{name}').bounding_box()
        assert box['x'] >= 0
        assert box['x'] + box['width'] <= 390
    visit.shot(f'phone_{scheme}')
    visit.page.set_viewport_size({'width': 1400, 'height': 1000})
    visit.page.wait_for_timeout(300)
    visit.shot(f'desktop_{scheme}')
    assert visit.js('document.body.classList.contains("body--dark")') is (scheme == 'dark')
    visit.close()
    assert visit.console == []


def test_all_controls_are_reached_by_the_keyboard(visit: Visit, stage: Stage) -> None:
    heard = stage.hear(interfaces.NUDGE)
    visit.tab('Drive')
    visit.page.focus('#live-dark')
    for _ in range(30):
        visit.page.keyboard.press('Tab')
        if visit.js('document.activeElement.id') == 'live-nudge':
            break
    assert visit.js('document.activeElement.id') == 'live-nudge'
    visit.page.keyboard.press('Enter')
    until(lambda: heard, 'the nudge')


def test_no_other_file_is_served(visit: Visit, view: Any) -> None:
    for path in (
        'live/../node.py',
        'live/plots.html',
        'live/%2e%2e/node.py',
        'docs',
        'openapi.json',
    ):
        answer = visit.page.request.get(f'http://127.0.0.1:{view.port}/{path}')
        assert answer.status == 404 or 'LiveView' not in answer.text(), path


def test_the_chain_message_that_comes_later_gives_scale_and_springs(
    visit: Visit, view: Any, stage: Stage
) -> None:
    rig = Rig(stage, '/rig/')
    named = NamedChain(Chain(number_of_rotors=9), default_joint_names(9))
    topic = interfaces.CHAIN
    publisher = stage.user.create_publisher(topic.type, '/rig/chain', topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    model = view.finder.chains['/rig/'].model
    until(lambda: model.named, 'the chain')
    visit.choose('chain', 'rig')
    until(
        lambda: rig.publish(9) or visit.js('live.shown && live.shown.extensions.length') == 8,
        'springs',
    )
    assert 'no chain' not in visit.js('live.view.note()')
    visit.choose('chain', 'chain')
    visit.wait('live.shown.rotors === 12')
