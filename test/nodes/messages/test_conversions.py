# SPDX-License-Identifier: Apache-2.0
"""Messages and physics types have equal content, and errors are one line."""

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    state_from_reset,
)
from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg

NAMED = NamedChain(Chain(number_of_rotors=5), default_joint_names(5))
ROTORS = {name: rotor for rotor, name in enumerate(NAMED.joint_names)}
ANGLES = np.array([0.1, -2.0, 3.5, 40.0, -0.0])
RATES = np.array([1.0, 2.0, -3.0, 1e-300, 5.0])
STAMP = time_to_msg(1_700_000_000_123_456_789)


@given(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1))
def test_times_keep_every_nanosecond(nanoseconds):
    assert time_from_msg(time_to_msg(nanoseconds)) == nanoseconds


def test_a_chain_and_its_names_come_back():
    deviations = Deviations((0.1, 0.2), (), (0.3, -0.4, 0.5), (), (0.0, -0.9), (1.0, 2.0, 3.0))
    law = Feedback(0.1, 0.2, 0.3, -0.4, 0.5, -0.6, reference=0.7, delay=8, limit=0.9)
    chain = Chain(3, 0.11, 0.07, 1.2, 0.03, 77.0, 1e-3, deviations=deviations, feedback=law)
    named = NamedChain(chain, ('left', 'middle', 'right'), (0.1, 0.0, -0.2))
    ring = NamedChain(Chain(number_of_rotors=4, periodic=True), default_joint_names(4))
    for each in (ring, named):
        message = conversions.chain_to_msg(each, STAMP)
        assert conversions.chain_from_msg(message) == each
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'linkage')


@given(st.permutations(range(5)))
def test_a_frame_comes_back_whatever_the_order_of_its_joints_and_whatever_others_there_are(order):
    message = conversions.frame_to_msg(NAMED, Frame(ANGLES, RATES), ANGLES + RATES, STAMP)
    shuffled = JointState(
        name=['gripper', *(message.name[n] for n in order)],
        position=[9.0, *(message.position[n] for n in order)],
        velocity=[8.0, *(message.velocity[n] for n in order)],
    )
    frame = conversions.frame_from_msg(NAMED, shuffled)
    np.testing.assert_array_equal(frame.angles, ANGLES)
    np.testing.assert_array_equal(frame.rates, RATES)


def test_a_frame_without_rates_has_none():
    message = conversions.frame_to_msg(NAMED, Frame(ANGLES, None), ANGLES, STAMP)
    assert conversions.frame_from_msg(NAMED, message).rates is None


def test_impulses_and_torques_come_back():
    impulses = conversions.impulses_to_msg(NAMED, ANGLES, STAMP)
    np.testing.assert_array_equal(conversions.impulses_from_msg(ROTORS, impulses, 40.0), ANGLES)
    torques = conversions.torques_to_msg(NAMED, ANGLES, STAMP)
    np.testing.assert_array_equal(conversions.torques_from_msg(ROTORS, torques, 40.0), ANGLES)
    assert (len(torques.position), len(torques.velocity)) == (0, 0)


def test_rotors_that_are_not_named_get_nothing():
    message = RotorImpulses(name=['rotor_3', 'rotor_1'], impulse=[3.0, 1.0])
    given_impulses = conversions.impulses_from_msg(ROTORS, message, 10.0)
    np.testing.assert_array_equal(given_impulses, [0.0, 1.0, 0.0, 3.0, 0.0])
    nothing = conversions.impulses_from_msg(ROTORS, RotorImpulses(), 10.0)
    np.testing.assert_array_equal(nothing, np.zeros(5))


def joint_state(**changes: Any) -> JointState:
    fields = {'name': list(NAMED.joint_names), 'position': list(ANGLES), 'velocity': list(RATES)}
    return JointState(**{**fields, **changes})


def impulses(**changes: Any) -> RotorImpulses:
    return RotorImpulses(**{'name': ['rotor_1', 'rotor_2'], 'impulse': [1.0, 2.0], **changes})


def torques(**changes: Any) -> JointState:
    return JointState(**{'name': ['rotor_1', 'rotor_2'], 'effort': [1.0, 2.0], **changes})


def take_frame(message: JointState) -> None:
    conversions.frame_from_msg(NAMED, message)


def take_impulses(message: RotorImpulses) -> None:
    conversions.impulses_from_msg(ROTORS, message, 10.0)


def take_torques(message: JointState) -> None:
    conversions.torques_from_msg(ROTORS, message, 10.0)


def test_a_wrong_message_is_rejected_with_the_reason():
    for take, message, complaint in [
        (take_frame, joint_state(name=[]), "lacks 5 of 5 rotors, first 'rotor_0'"),
        (
            take_frame,
            joint_state(name=['rotor_0', 'rotor_1', 'rotor_2', 'rotor_4', 'spare']),
            "lacks 1 of 5 rotors, first 'rotor_3'",
        ),
        (
            take_frame,
            joint_state(name=['rotor_0', 'rotor_1', 'rotor_2', 'rotor_3', 'rotor_3']),
            "'rotor_3' twice; name each joint once",
        ),
        (take_frame, joint_state(position=[1.0]), 'position has 1 values for 5 names'),
        (take_frame, joint_state(position=[]), 'position has 0 values for 5 names'),
        (take_frame, joint_state(velocity=[1.0, 2.0]), 'velocity has 2 values for 5 names'),
        (
            take_frame,
            joint_state(position=[0.0, math.nan, 0.0, 0.0, 0.0]),
            'position of rotor_1 = nan must be a finite number',
        ),
        (
            take_frame,
            joint_state(position=[0.0, 1e308, 0.0, 0.0, 0.0]),
            'position of rotor_1 = 1e+308 must lie in the range -1e+09 to 1e+09; check its pub',
        ),
        (
            take_frame,
            joint_state(velocity=[0.0, math.inf, 0.0, -math.inf, 0.0]),
            'velocity of rotor_1 = inf must be a finite number',
        ),
        (take_impulses, impulses(impulse=[1.0]), 'impulse has 1 values for 2 names'),
        (
            take_impulses,
            impulses(impulse=[1.0, math.nan]),
            'impulse of rotor_2 = nan must be a finite number',
        ),
        (
            take_impulses,
            impulses(impulse=[1.0, -10.5]),
            'impulse of rotor_2 = -10.5 must lie in the range -10 to 10',
        ),
        (
            take_impulses,
            impulses(name=['rotor_1', 'rotor_5']),
            "names joint 'rotor_5', which is none of 'rotor_0' to 'rotor_4'",
        ),
        (take_impulses, impulses(name=['rotor_1', 'rotor_1']), "'rotor_1' twice"),
        (take_torques, torques(effort=[]), 'effort has 0 values for 2 names'),
        (
            take_torques,
            torques(effort=[math.inf, 1.0]),
            'effort of rotor_1 = inf must be a finite number',
        ),
        (
            take_torques,
            torques(effort=[0.0, 11.0]),
            'effort of rotor_2 = 11 must lie in the range -10 to 10',
        ),
        (take_torques, torques(name=['rotor_1', '']), "names joint ''"),
    ]:
        with pytest.raises(ValueError, match=re.escape(complaint)) as refusal:
            take(message)
        assert '\n' not in str(refusal.value)


def test_a_message_that_describes_no_chain_is_rejected():
    for changes, complaint in [
        ({'spacing': math.nan}, 'spacing = nan must be a finite number'),
        ({'mass': -1.0}, 'mass = -1.0 must lie in the range'),
        ({'joint_names': ['only']}, 'number_of_rotors = 1 must lie in the range'),
        ({'joint_names': ['a', 'b', 'a']}, "'a' twice"),
        ({'mass_deviations': [0.1]}, '1 deviations of mass do not fit a chain of 5 rotors'),
        ({'mass_deviations': [-1.5] * 5}, 'deviation 0 of mass = -1.5 must be'),
        ({'encoder_offsets': [0.1]}, '1 offsets of encoders do not fit a chain of 5 rotors'),
        ({'encoder_offsets': [math.nan] * 5}, 'offset of rotor 0 = nan rad must lie in the range'),
    ]:
        message = conversions.chain_to_msg(NAMED, STAMP)
        for name, value in changes.items():
            setattr(message, name, value)
        with pytest.raises(ValueError, match=re.escape(complaint)):
            conversions.chain_from_msg(message)


def test_a_reset_by_name_moves_the_named_joints_and_stops_the_others():
    named = NamedChain(Chain(number_of_rotors=3), ('a', 'b', 'c'))
    now = State(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    request = Reset.Request(name=['c', 'a'], angle=[0.5, -0.5], rate=[7.0, 8.0])
    state = state_from_reset(named, request, now)
    assert state.angles.tolist() == [-0.5, 2.0, 0.5]
    assert state.rates.tolist() == [8.0, 0.0, 7.0]
    resting = state_from_reset(named, Reset.Request(name=['b'], angle=[9.0]), now)
    assert resting.angles.tolist() == [1.0, 9.0, 3.0]
    assert not resting.rates.any()
    assert now.angles.tolist() == [1.0, 2.0, 3.0]


def test_a_wrong_reset_by_name_is_rejected():
    for request_, complaint in [
        (Reset.Request(name=['d'], angle=[1.0]), "reset.angle names joint 'd', which is none of"),
        (Reset.Request(name=['a', 'a'], angle=[1.0, 2.0]), "'a' twice"),
        (Reset.Request(name=['a'], angle=[]), 'reset.angle has 0 values for 1 names'),
        (Reset.Request(name=['a'], angle=[math.nan]), 'reset.angle of a = nan must be a finite'),
        (Reset.Request(name=['a'], angle=[1.0], rate=[1.0, 2.0]), 'reset.rate has 2 values for 1'),
        (Reset.Request(name=['a'], angle=[1.0], rate=[math.inf]), 'reset.rate of a = inf must be'),
    ]:
        named = NamedChain(Chain(number_of_rotors=3), ('a', 'b', 'c'))
        with pytest.raises(ValueError, match=re.escape(complaint)):
            state_from_reset(named, request_, State(np.zeros(3), np.zeros(3)))
