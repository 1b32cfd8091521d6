# SPDX-License-Identifier: Apache-2.0

import pytest
from live_stage import Rig
from programs import until

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


@pytest.fixture(scope='module')
def rig(stage, view):
    """Joints without the topic chain."""
    made = Rig(stage, '/rig/')
    made.go(6)
    until(lambda: '/rig/' in view.chains, 'the chain to be found')
    yield made
    made.close()


def test_a_source_stops_and_returns_with_another_number_of_rotors(visit, view, rig):
    rig.go(6)
    visit.choose('chain', 'rig')
    visit.wait('live.watched === "/rig/" && live.shown && live.shown.rotors === 6')
    assert 'no topic chain' in visit.js('live.view.note()')
    rig.stop()
    visit.wait(
        '/^no joint_states for [1-9]/.test(document.getElementById("live-stale").textContent)'
    )
    stale = visit.page.locator('#live-stale')
    assert stale.evaluate('e => getComputedStyle(e).backgroundColor') == 'rgb(176, 0, 32)'
    assert 'paused' not in (stale.get_attribute('class') or '')
    visit.tab('Run')
    visit.panel_has_text('only a simulator can do this')
    assert visit.page.locator('#live-pause').is_disabled()
    visit.tab('Drive')
    visit.panel_has_text('no node subscribes to nudge')
    rig.go(9)
    visit.wait('live.shown.rotors === 9')
    visit.wait('document.getElementById("live-stale").hidden')
    visit.choose('chain', 'all side by side')
    visit.wait('["/", "/rig/"].every((name) => live.tiles.get(name)?.view.frame?.age < 0.5)')
    visit.page.locator('.live-tile[data-chain="/"]').click()
    visit.wait('live.watched === "/" && live.shown.rotors === 12')


def test_encoders_with_an_actuator_are_driven_like_a_simulator(visit, view, stage):
    named = NamedChain(Chain(number_of_rotors=9), default_joint_names(9))
    topic = interfaces.CHAIN
    publisher = stage.user.create_publisher(topic.type, '/arm/chain', topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    stage.start(EdgeActuator, namespace='arm')
    subscription = stage.subscribe(interfaces.ROTOR_IMPULSES, '/arm/')
    received = stage.record(interfaces.ROTOR_IMPULSES)
    arm = Rig(stage, '/arm/')
    arm.go(9)
    until(lambda: '/arm/' in view.chains, 'the chain to be found')
    visit.choose('chain', 'arm')
    visit.wait('live.watched === "/arm/" && live.shown.extensions.length === 8')
    assert 'no topic chain' not in visit.js('live.view.note()')
    visit.tab('Run')
    visit.panel_has_text('only a simulator can do this')
    visit.tab('Drive')
    nudge = visit.page.locator('#live-nudge:enabled')
    until(lambda: nudge.click() or received, 'the impulses')
    stage.user.destroy_subscription(subscription)
    visit.choose('chain', 'chain')
    visit.wait('live.watched === "/" && live.shown.rotors === 12')
    arm.close()


def test_a_page_that_changes_the_chain_while_a_frame_is_pending_continues(visit, rig):
    for name in ('*', '/rig/', '*', '/', '*', '/'):
        visit.page.evaluate(
            """async (name) => {
            while (!live.pending.size) await new Promise((done) => setTimeout(done));
            live.watch(name); }""",
            name,
        )
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')


def test_a_source_without_messages_is_dropped_when_it_ends(view, stage):
    ghost = Rig(stage, '/ghost/')
    until(lambda: '/ghost/' in view.chains, 'the chain to be found')
    ghost.close()
    until(lambda: '/ghost/' not in view.chains, 'the chain to be dropped')


def test_ten_thousand_rotors_are_shown_in_groups(visit, stage):
    rig = Rig(stage, '/long/')
    rig.go(10_000)
    visit.choose('chain', 'long')
    visit.wait('live.shown.rotors === 10000 && live.shown.overview.length === 2048')
    assert visit.colours('chain') > 3
    visit.js('live.view.move(5000, 5050)')
    visit.wait('live.shown.angles.length > 40 && live.shown.angles.length < 70')
    rig.close()
    visit.choose('chain', 'chain')
    visit.wait('live.shown.rotors === 12')
