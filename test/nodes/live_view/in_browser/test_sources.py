# SPDX-License-Identifier: Apache-2.0
"""Other sources than the simulator of the suite, and several of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from live_stage import Rig, Stage, Visit, until

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
def rig(stage: Stage, view: Any) -> Iterator[Rig]:
    """Joints without a chain, which do not move and stop when they are told to."""
    made = Rig(stage, '/rig/')
    made.go(6)
    until(lambda: '/rig/' in view.finder.chains, 'the chain to be found')
    yield made
    made.close()


def test_a_source_that_stops_comes_back_and_changes_its_rotors(
    visit: Visit, view: Any, rig: Rig
) -> None:
    visit.choose('chain', 'rig')
    visit.wait('live.watched === "/rig/" && live.shown && live.shown.rotors === 6')
    assert 'no chain' in visit.js('live.view.note()')
    rig.stop()
    visit.wait(
        '/^no joint_states since [1-9]/.test(document.getElementById("live-stale").textContent)'
    )
    stale = visit.page.locator('#live-stale')
    assert stale.evaluate('e => getComputedStyle(e).backgroundColor') == 'rgb(176, 0, 32)'
    assert 'paused' not in (stale.get_attribute('class') or '')
    visit.shot('stopped')
    visit.tab('Run')
    visit.panel_says('only a simulator does that')
    assert visit.page.locator('#live-pause').is_disabled()
    visit.tab('Drive')
    visit.panel_says('nothing subscribes to nudge')
    rig.go(9)
    visit.wait('live.shown.rotors === 9')
    visit.wait('document.getElementById("live-stale").hidden')
    visit.choose('chain', 'all side by side')
    visit.wait('document.querySelectorAll(".live-tile").length === 2')
    visit.wait('[...live.tiles.values()].every(({ view }) => view.frame.age < 0.5)')
    visit.shot('run_parallel')
    visit.page.locator('.live-tile[data-chain="/"]').click()
    visit.wait('live.watched === "/" && live.shown.rotors === 12')


def test_encoders_with_a_chain_and_an_actuator_are_driven_as_a_simulator_is(
    visit: Visit, rig: Rig, stage: Stage
) -> None:
    named = NamedChain(Chain(number_of_rotors=9), default_joint_names(9))
    topic = interfaces.CHAIN
    publisher = stage.user.create_publisher(topic.type, '/rig/chain', topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    stage.start(EdgeActuator, namespace='rig')
    listening = stage.listen(interfaces.ROTOR_IMPULSES, '/rig/')
    heard = stage.hear(interfaces.ROTOR_IMPULSES)
    rig.go(9)
    visit.choose('chain', 'rig')
    visit.wait('live.watched === "/rig/" && live.shown.extensions.length === 8')
    assert 'no chain' not in visit.js('live.view.note()')
    visit.tab('Run')
    visit.panel_says('only a simulator does that')
    visit.tab('Drive')
    nudge = visit.page.locator('#live-nudge:enabled')
    until(lambda: nudge.click() or heard, 'the impulses')
    stage.user.destroy_subscription(listening)
    visit.choose('chain', 'chain')
    visit.wait('live.watched === "/" && live.shown.rotors === 12')


def test_a_page_that_looks_elsewhere_in_the_middle_of_a_picture_gets_the_next(
    visit: Visit, rig: Rig
) -> None:
    for name in ('*', '/rig/', '*', '/', '*', '/'):
        visit.page.evaluate(
            """async (name) => {
            while (!live.pending.size) await new Promise((done) => setTimeout(done));
            live.watch(name); }""",
            name,
        )
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')


def test_a_source_that_goes_before_it_was_heard_is_not_a_chain(view: Any, stage: Stage) -> None:
    ghost = Rig(stage, '/ghost/')
    until(lambda: '/ghost/' in view.finder.chains, 'the chain to be found')
    ghost.close()
    until(lambda: '/ghost/' not in view.finder.chains, 'it to be forgotten')


def test_ten_thousand_rotors_are_shown_in_groups(visit: Visit, stage: Stage) -> None:
    rig = Rig(stage, '/long/')
    rig.go(10_000)
    visit.choose('chain', 'long')
    visit.wait('live.shown.rotors === 10000 && live.shown.overview.length === 2048')
    visit.shot('ten_thousand')
    assert visit.painted('chain') > 3
    visit.js('live.view.move(5000, 5050)')
    visit.wait('live.shown.angles.length > 40 && live.shown.angles.length < 70')
    rig.close()
    visit.choose('chain', 'chain')
    visit.wait('live.shown.rotors === 12')


def test_what_nodes_report_cannot_end_the_page(visit: Visit, view: Any, stage: Stage) -> None:
    topic = interfaces.DIAGNOSTICS
    publisher = stage.user.create_publisher(topic.type, topic.name, topic.qos)
    figures = ('moves begun', 'move to rotor', 'lost messages', 'gravity [m/s^2]', 'tilt [rad]')
    pairs = [{'key': name, 'value': 'nonsense'} for name in figures]
    until(
        lambda: (
            publisher.publish(report('/rig/soliton_steering', pairs))
            or '/rig/soliton_steering' in view.finder.reports
        ),
        'the report',
    )
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')
    assert view.failure is None
    stage.user.destroy_publisher(publisher)


def report(node: str, pairs: list[dict[str, str]]) -> Any:
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    values = [KeyValue(**pair) for pair in pairs]
    status = DiagnosticStatus(name=f'{node}: x', hardware_id=node, values=values)
    return DiagnosticArray(status=[status])
