# SPDX-License-Identifier: Apache-2.0
"""Joint states are read as far as they go, and refused where they contradict themselves."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from joint_frames import frame_of
from sensor_msgs.msg import JointState

from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.identification.mounting import in_degrees
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_from_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.messages.frames import EncoderMonitor, FrameReader
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

NAMES = default_joint_names(5)
ANGLES = np.array([0.1, -2.0, 3.5, 40.0, -0.0])
RATES = np.array([1.0, 2.0, -3.0, 1e-300, 5.0])


def joint_state(**changes: Any) -> JointState:
    fields = {'name': list(NAMES), 'position': list(ANGLES), 'velocity': list(RATES)}
    return JointState(**{**fields, **changes})


def test_incomplete_frames_are_read_as_far_as_possible():
    reader = FrameReader(NAMES)

    def read(message: JointState) -> Frame:
        return reader.read(joint_states_from_msg(message))

    message = JointState(
        name=['gripper', 'rotor_4', 'rotor_0', 'rotor_2'],
        position=[9.0, 4.5, math.inf, math.nan],
        velocity=[8.0, 1.0, 2.0, 3.0],
    )
    for _ in range(2):
        frame = read(message)
        np.testing.assert_array_equal(frame.angles, [math.nan, math.nan, math.nan, math.nan, 4.5])
        assert frame.rates is not None
        np.testing.assert_array_equal(frame.rates, [2.0, math.nan, 3.0, math.nan, 1.0])
    message.velocity = []
    assert read(message).rates is None
    message.name, message.position = ['rotor_1'], [7.0]
    np.testing.assert_array_equal(read(message).angles, [math.nan, 7.0] + 3 * [math.nan])


def test_known_offsets_of_encoders_are_taken_off():
    offsets = (0.05, 0.0, -0.1, 0.2, 0.0)
    reader = FrameReader(NAMES, offsets)
    for order in ([0, 1, 2, 3, 4], [3, 1, 4, 0, 2]):
        message = joint_state(
            name=[NAMES[n] for n in order],
            position=ANGLES[order].tolist(),
            velocity=RATES[order].tolist(),
        )
        frame = reader.read(joint_states_from_msg(message))
        np.testing.assert_array_equal(frame.angles, ANGLES - offsets)
        np.testing.assert_array_equal(frame.rates, RATES)
        strict = frame_from_msg(NamedChain(Chain(5), NAMES, offsets), message)
        np.testing.assert_array_equal(strict.angles, frame.angles)


def test_frames_in_the_order_of_the_rotors_are_read_without_sharing_memory():
    reader = FrameReader(NAMES)
    joints = joint_states_from_msg(joint_state())
    frame = reader.read(joints)
    np.testing.assert_array_equal(frame.angles, ANGLES)
    np.testing.assert_array_equal(frame.rates, RATES)
    frame.angles[:] = 0.0
    np.testing.assert_array_equal(joints.position, ANGLES)


def test_contradictory_joint_states_are_rejected():
    for message, complaint in [
        (joint_state(name=[]), 'position has 5 values for 0 names'),
        (joint_state(name=list('abcde')), 'has none of the 5 rotors, such as'),
        (joint_state(name=['rotor_1'] * 5), "'rotor_1' twice; name each joint once"),
        (joint_state(position=[1.0]), 'position has 1 values for 5 names'),
        (joint_state(velocity=[1.0]), 'velocity has 1 values for 5 names'),
    ]:
        with pytest.raises(ValueError, match=re.escape(complaint)):
            FrameReader(NAMES).read(joint_states_from_msg(message))


def test_values_beyond_encoders_are_missing():
    message = JointState(name=['a', 'b', 'c'], position=[1e308, 0.5, -1e308])
    frame = FrameReader(('a', 'b', 'c')).read(joint_states_from_msg(message))
    np.testing.assert_array_equal(frame.angles, [np.nan, 0.5, np.nan])


CHAINS = (
    Chain(number_of_rotors=20),
    Chain(number_of_rotors=20, rotor_length=0.1, rest_angle=0.77),
    Chain(number_of_rotors=20, rotor_length=0.2, rest_angle=1.18),
)


def states(chain: Chain) -> list[Array]:
    """States of a chain; the rotors of a spinner have turned several times."""
    walls = [with_soliton(chain, place, 0.0).angles for place in (1.0, 8.3, 17.0)]
    turned = [angles + 2 * np.pi * np.arange(20) for angles in walls]
    return [chain.uniform_state(-1), chain.uniform_state(1), *walls, *turned]


def test_degrees_are_distinguished_from_radians():
    for noise in [0.0, 0.05]:
        for chain in CHAINS:
            errors = noise * np.random.default_rng(7).standard_normal(20)
            for angles in states(chain):
                assert not in_degrees(angles + errors)
                assert in_degrees(np.rad2deg(angles + errors))


def test_rotors_that_are_not_seen_are_passed_over():
    angles = np.rad2deg(CHAINS[0].uniform_state(1))
    angles[::5] = np.nan
    assert in_degrees(angles)
    assert not in_degrees(np.full(20, np.nan))
    assert not in_degrees(np.full(20, np.inf))


def test_each_mistake_is_logged_once():
    told: list[str] = []
    watch = EncoderMonitor(told.append)
    angles = CHAINS[0].uniform_state(1)
    for stamp in (5, 6, 7, 9):
        watch.check(stamp * SECOND, angles)
    watch.check(2 * SECOND, angles)
    assert told == []
    for stamp in (3 * SECOND, 3 * SECOND, 2 * SECOND + 1, 0, 0):
        watch.check(stamp, angles)
    assert [line.split(';')[0] for line in told] == [
        'joint_states are not in order: a stamp is equal to the previous one',
        'joint_states have no stamps',
    ]


@pytest.mark.parametrize('create', [SolitonAnalyser, EdgeActuator, SolitonSteering])
def test_the_nodes_log_mistakes(graph, create, said):
    chain = replace(Chain(), number_of_rotors=8)
    graph.start(create, {'chain_from': 'parameters', 'chain.number_of_rotors': 8})
    publisher = graph.speak(interfaces.JOINT_STATES)
    angles = np.rad2deg(chain.uniform_state(-1))
    named = NamedChain(chain, default_joint_names(8))
    message = frame_of(named, angles)

    def told() -> bool:
        publisher.publish(message)
        return 'look like degrees' in said() and 'have no stamps' in said()

    graph.until(told, 'the warnings')
    assert said().count('look like degrees') == said().count('have no stamps') == 1
