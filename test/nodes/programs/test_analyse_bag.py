# SPDX-License-Identifier: Apache-2.0
"""Offline analysis equals the live analysis; an invalid bag is reported."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_frames import frame_of
from rclpy.duration import Duration
from recordings import START, write_bag
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.dynamics.elastic import ElasticSimulation, simulate
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import RotorImpulses, Soliton, SolitonEvent, SolitonState
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
    impulses_to_msg,
)
from soliton_linkage_nodes.messages.state_conversions import events_to_msgs, state_to_msg
from soliton_linkage_nodes.programs import analyse_bag
from soliton_linkage_nodes.programs.analyse_bag import main
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

BAGS = Path(__file__).resolve().parents[3] / 'bags'
NAMES = ['flipper', 'wobbler', 'spinner']
NAMED = NamedChain(Chain(number_of_rotors=10), default_joint_names(10))
PERIOD = 20 * 10**6


@pytest.fixture(autouse=True)
def pictures(monkeypatch):
    """Return the folders of the pictures, which are not drawn."""
    folders: list[Path] = []
    monkeypatch.setattr(analyse_bag, 'save_run', lambda *given: folders.append(given[-1]))
    return folders


def frames() -> list[JointState]:
    """A wall that leaves the edge, seen by noisy encoders."""
    chain = NAMED.chain
    start = chain.uniform_state(-1)
    record = simulate(chain, start, 10 * mode_towards_last(chain, start), 1.0, 0.02)
    generator = np.random.default_rng(3)
    angles = record.angles + 0.01 * generator.standard_normal(record.angles.shape)
    return [frame_of(NAMED, each, START + number * PERIOD) for number, each in enumerate(angles)]


def bag_of(folder: Path, messages: Sequence[JointState], chain: bool = True) -> Path:
    entries: list[Any] = [
        (interfaces.JOINT_STATES, START + number * PERIOD, message)
        for number, message in enumerate(messages)
    ]
    if chain:
        # A latched topic may be recorded after the first frames.
        told = (interfaces.CHAIN, START + 7 * PERIOD + 1, chain_to_msg(NAMED, time_to_msg(START)))
        entries.insert(8, told)
    return write_bag(folder / 'run', entries)


def chain_file(folder: Path, parameters: str) -> str:
    path = folder / 'chain.yaml'
    path.write_text(f'/**: {{ros__parameters: {{chain: {{{parameters}}}}}}}')
    return str(path)


def states_of(bag: Path) -> list[SolitonState]:
    """Return the states of all frames; no frame is late."""
    with open_bag(bag) as reader:
        found = list(analyse_frames(reader))
    return [state_to_msg(analysis, joints) for joints, analysis in found if analysis is not None]


def events_of(bag: Path) -> list[SolitonEvent]:
    with open_bag(bag) as reader:
        found = [(each, joints) for joints, each in analyse_frames(reader) if each is not None]
    return [event for pair in found for event in events_to_msgs(*pair, NAMED.chain.spacing)]


def rows(folder: Path, name: str = 'soliton_state') -> list[dict[str, str]]:
    with (folder / f'{name}.csv').open(newline='') as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize('name', NAMES)
def test_recorded_bags_give_the_states_that_were_published_live(name):
    """Within the stated deviations, because the bag is from another machine."""
    with open_bag(BAGS / f'{name}_0') as reader:
        live = [state for _, state in read_topic(reader, 'soliton_state')]
    offline = states_of(BAGS / f'{name}_0')
    assert [state.header for state in offline] == [state.header for state in live]
    assert len(live) > 500
    for one, other in zip(offline, live, strict=True):
        assert len(one.solitons) == len(other.solitons)
        assert one.status == other.status
        for wall, same in zip(one.solitons, other.solitons, strict=True):
            assert abs(wall.position - same.position) < same.position_deviation


KICKS = (14, 23, 30)
SURENESS = np.where(np.arange(10) % 2, 0.1, 0.01)
"""Standard deviations of the angles [rad]."""


def deviations_of(stamp: int) -> JointState:
    return JointState(
        header=Header(stamp=time_to_msg(stamp)),
        name=list(reversed(NAMED.joint_names)),
        position=SURENESS[::-1].tolist(),
    )


def kicked() -> list[tuple[interfaces.Topic, JointState | RotorImpulses]]:
    """A noisy wall that is kicked three times, each kick before the frame at which it acts.

    Standard deviations come before their frames, and one in three does not come.
    """
    chain = NAMED.chain
    start = chain.uniform_state(-1)
    rates = 10 * mode_towards_last(chain, start)
    simulation = ElasticSimulation(chain, start, rates, PERIOD / SECOND, 1e-7)
    generator = np.random.default_rng(3)
    sent: list[tuple[interfaces.Topic, JointState | RotorImpulses]] = []
    for number in range(40):
        stamp = time_to_msg(START + number * PERIOD)
        if number in KICKS:
            impulse = -0.2 * chain.moment_of_inertia * simulation.rates
            simulation.kick(impulse)
            sent.append((interfaces.DELIVERED_IMPULSES, impulses_to_msg(NAMED, impulse, stamp)))
        if number % 3:
            deviations = deviations_of(START + number * PERIOD)
            sent.append((interfaces.JOINT_STATE_DEVIATIONS, deviations))
        noise = SURENESS if number % 3 else SURENESS.min()
        seen = simulation.angles + noise * generator.standard_normal(chain.number_of_rotors)
        sent.append((interfaces.JOINT_STATES, frame_of(NAMED, seen, START + number * PERIOD)))
        simulation.advance()
    return sent


def test_a_node_and_a_bag_use_kicks_and_deviations_equally(graph, tmp_path):
    sent, told = kicked(), chain_to_msg(NAMED, time_to_msg(START))
    entries: list[Any] = [(interfaces.CHAIN, START - 1, told)]
    entries += [(topic, START + number, message) for number, (topic, message) in enumerate(sent)]
    bag = write_bag(tmp_path / 'bag', entries)
    offline = states_of(bag)
    frames_alone = [entry for entry in entries if entry[0] is not interfaces.DELIVERED_IMPULSES]
    untold = states_of(write_bag(tmp_path / 'frames', frames_alone))
    without = [entry for entry in entries if entry[0] is not interfaces.JOINT_STATE_DEVIATIONS]
    unweighed = states_of(write_bag(tmp_path / 'alike', without))
    states, events = graph.hear(interfaces.SOLITON_STATE), graph.hear(interfaces.SOLITON_EVENTS)
    graph.start(SolitonAnalyser, {'longest_lag': 0.0})
    first_of_frame = (interfaces.DELIVERED_IMPULSES, interfaces.JOINT_STATE_DEVIATIONS)
    heard = (interfaces.JOINT_STATES, *first_of_frame)
    speakers = {topic.name: graph.speak(topic) for topic in heard}
    begun = time_to_msg(START + 20 * PERIOD)
    # Kicks that came before the chain wait for it, as frames do.
    for topic, message in sent:
        speakers[topic.name].publish(message)
        if topic in first_of_frame:
            assert speakers[topic.name].wait_for_all_acked(Duration(seconds=240))
        if topic is interfaces.JOINT_STATES and message.header.stamp == begun:
            interfaces.CHAIN.publisher(graph.user).publish(told)
            graph.until(lambda: states, 'the chain')
    graph.until(lambda: len(states) == len(offline), 'all states')
    assert list(map(repr, offline)) == list(map(repr, states))
    expected = events_of(bag)
    assert expected[0].kind == SolitonEvent.BIRTH_AT_EDGE
    graph.until(lambda: len(events) == len(expected), 'all events', lambda: events)
    assert list(map(repr, expected)) == list(map(repr, events))
    first = KICKS[0]
    assert list(map(repr, untold))[:first] == list(map(repr, offline))[:first]
    (before,), (wall,), (unaware,) = (
        each.solitons for each in (offline[first - 1], offline[first], untold[first])
    )
    assert wall.velocity == pytest.approx(0.8 * before.velocity, rel=0.1)
    assert unaware.velocity > 0.95 * before.velocity
    (weighed,), (alike,) = offline[-1].solitons, unweighed[-1].solitons
    assert weighed.position_deviation < alike.position_deviation


def cells_of(message: Any, prefix: str = '') -> dict[str, Any]:
    """Fields of a message and of those in it by name; of several, of the first."""
    cells: dict[str, Any] = {}
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if name == 'solitons':
            cells[name] = len(value)
            first = cells_of(value[0] if value else Soliton(), 'soliton_')
            cells.update(first if value else dict.fromkeys(first, math.nan))
        elif name != 'header':
            nested = hasattr(value, 'get_fields_and_field_types')
            cells.update(cells_of(value, f'{name}_') if nested else {prefix + name: value})
    return cells


def test_the_table_holds_every_number_to_the_last_digit(tmp_path, pictures):
    bag = bag_of(tmp_path, frames())
    main([str(bag), '--output', str(tmp_path / 'out')])
    states = states_of(bag)
    table = rows(tmp_path / 'out')
    assert len(table) == len(states) == len(frames())
    for cells, state in zip(table, states, strict=True):
        stamp = time_from_msg(state.header.stamp)
        expected = {'stamp': stamp, **cells_of(state)}
        named = [(name.partition(' [')[0], value) for name, value in cells.items()]
        assert named == [(name, str(value)) for name, value in expected.items()]
    seen = next(number for number, state in enumerate(states) if state.solitons)
    assert float(table[seen]['soliton_rotor [rotor spacings]']) == states[seen].solitons[0].rotor
    assert table[0]['soliton_rotor [rotor spacings]'] == 'nan'
    (birth,) = events_of(bag)
    (cells,) = rows(tmp_path / 'out', 'soliton_events')
    assert cells['kind_name'] == 'birth at an edge'
    assert cells['ids_after'] == '1' == table[seen]['soliton_id']
    assert cells['stamp [ns]'] == str(time_from_msg(birth.header.stamp))
    assert cells['time [ns]'] == str(time_from_msg(birth.time)) == table[seen]['stamp [ns]']
    assert cells['energy_after [J]'] == str(birth.energy_after)
    assert pictures == [tmp_path / 'out']


def test_a_bag_of_joint_states_alone_needs_a_chain(tmp_path):
    bag = bag_of(tmp_path, frames(), chain=False)
    with pytest.raises(SystemExit) as end:
        main([str(bag), '--output', str(tmp_path / 'out')])
    assert "has no topic 'chain'" in str(end.value)
    assert str(end.value).endswith('specify the chain with --chain, or record the topic chain')
    given = chain_file(tmp_path, 'number_of_rotors: 10')
    main([str(bag), '--output', str(tmp_path / 'out'), '--chain', given])
    whole = bag_of(tmp_path, frames())
    main([str(whole), '--output', str(tmp_path / 'whole')])
    assert rows(tmp_path / 'out') == rows(tmp_path / 'whole')


def test_a_chain_that_is_not_that_of_the_bag_is_asked_for_twice(tmp_path, capsys):
    bag, output = bag_of(tmp_path, frames()), ['--output', str(tmp_path / 'out')]
    main([str(bag), '--chain', chain_file(tmp_path, 'number_of_rotors: 10'), *output])
    given = chain_file(tmp_path, 'number_of_rotors: 10, rest_angle: 0.5')
    with pytest.raises(SystemExit) as end:
        main([str(bag), '--chain', given, *output])
    changed = f'rest_angle 0.5 for {NAMED.chain.rest_angle:g}'
    assert f'{changed}; omit --chain' in str(end.value)
    assert 'rest_angle' not in capsys.readouterr().err
    main([str(bag), '--chain', given, '--override', *output])
    assert f'--chain replaces the chain of the bag: {changed}\n' in capsys.readouterr().err


def test_an_invalid_noise_is_rejected(capsys):
    for noise in ['-1', '0', 'nan', 'inf', 'much']:
        with pytest.raises(SystemExit) as end:
            main(['bag', '--noise', noise])
        assert end.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f'noise {noise} must be above 0 and at most 1 rad' in line


def test_rejected_frames_are_skipped_and_only_the_first_are_logged(tmp_path, capsys):
    messages = frames()
    for message in messages[10:30]:
        message.position = message.position[:3]
    messages.insert(32, messages[31])
    main([str(bag_of(tmp_path, messages)), '--output', str(tmp_path / 'out')])
    said = capsys.readouterr().err
    assert 'rejected joint_states: joint_states.position has 3 values for 10 names' in said
    assert said.count('rejected joint_states') == 4
    assert 'rejected joint_states: 20 in all' in said
    assert '1 late frames skipped' in said
    assert len(rows(tmp_path / 'out')) == len(frames()) - 20


def test_joints_of_a_given_chain_that_are_not_in_the_bag_are_reported(tmp_path, capsys):
    bag = bag_of(tmp_path, frames(), chain=False)
    given = [str(bag), '--output', str(tmp_path / 'out'), '--chain']
    given.append(chain_file(tmp_path, 'number_of_rotors: 14'))
    line = "has no angle of 4 of the 14 joints of the chain: 'rotor_10' to 'rotor_13'"
    with pytest.raises(SystemExit, match=f'{line}; correct --chain, or add --missing-joints'):
        main(given)
    main([*given, '--missing-joints'])
    assert line in capsys.readouterr().err
    assert len(rows(tmp_path / 'out')) == len(frames())


def test_frames_without_stamps_are_analysed_at_their_log_times_if_requested(tmp_path):
    messages = frames()
    for message in messages:
        message.header.stamp = time_to_msg(0)
    given = [str(bag_of(tmp_path, messages)), '--output', str(tmp_path / 'out')]
    with pytest.raises(SystemExit, match='frames have the stamp 0; add --stamps log'):
        main(given)
    main([*given, '--stamps', 'log'])
    stamps = [int(row['stamp [ns]']) for row in rows(tmp_path / 'out')]
    assert stamps == [START + number * PERIOD for number in range(len(messages))]
