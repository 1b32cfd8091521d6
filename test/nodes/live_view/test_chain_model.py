# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from page_messages import unpack

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_nodes.live_view.chain_model import MOST_ANGLES, ChainModel, overview
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain, default_joint_names


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def named(rotors: int) -> NamedChain:
    return NamedChain(Chain(number_of_rotors=rotors), default_joint_names(rotors))


def model_of(chain: NamedChain, clock: Clock | None = None) -> ChainModel:
    model = ChainModel(clock) if clock else ChainModel()
    model.set_chain(chain)
    return model


def joints(names: tuple[str, ...], angles: Array, second: int = 5) -> JointStates:
    return JointStates(second, 0, 'linkage', names, angles, np.zeros(len(angles)))


def shown(model: ChainModel, last: int = 10_000) -> tuple[dict[str, float], dict[str, Array]]:
    return unpack(model.packed(0, 0, last))


def test_a_frame_contains_the_quantities_of_the_physics_package():
    chain, model = named(12), ChainModel()
    angles = chain.chain.uniform_state(-1) + 0.05 * np.sin(np.arange(12))
    model.set_chain(chain)
    model.update_joints(joints(chain.joint_names, angles))
    numbers, arrays = shown(model)
    assert numbers['rotors'] == 12
    assert numbers['stamp'] == 5.0
    np.testing.assert_allclose(arrays['angles'], angles, rtol=1e-6)
    np.testing.assert_allclose(arrays['overview'], chain.chain.positions(angles)[0], rtol=1e-5)
    extensions = chain.chain.spring_extensions(angles)
    np.testing.assert_allclose(arrays['extensions'], extensions, rtol=1e-5)
    mode = zero_mode(chain.chain, angles)
    np.testing.assert_allclose(np.abs(arrays['mode']), np.abs(mode), rtol=1e-5, atol=1e-30)
    energy = chain.chain.elastic_energy(angles)
    assert numbers['elastic'] == pytest.approx(energy)


def test_without_a_chain_a_frame_contains_only_the_lean():
    model = ChainModel()
    model.update_joints(joints(('shoulder', 'elbow'), np.array([0.5, -0.5])))
    numbers, arrays = shown(model)
    np.testing.assert_allclose(arrays['overview'], np.sin([0.5, -0.5]), rtol=1e-6)
    assert not len(arrays['extensions'])
    assert not len(arrays['mode'])
    assert math.isnan(numbers['elastic'])
    assert model.description()['spacing'] is None


def test_the_age_grows_until_the_next_message():
    clock = Clock()
    model, chain = ChainModel(clock), named(4)
    assert shown(model)[0]['age'] == math.inf
    model.set_chain(chain)
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    clock.now += 1.2
    assert shown(model)[0]['age'] == pytest.approx(1.2)
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1), 7))
    assert shown(model)[0]['age'] == 0.0


def test_another_number_of_rotors_resets_the_history():
    model = ChainModel()
    for rotors in (6, 9, 3):
        names = default_joint_names(rotors)
        version = model.version
        model.update_joints(joints(names, np.zeros(rotors)))
        assert shown(model)[0]['rotors'] == rotors
        assert model.version > version
        assert len(model.history[-1].overview) == rotors
    model.set_chain(named(5))
    model.update_joints(joints(default_joint_names(5), np.zeros(5)))
    assert shown(model)[0]['rotors'] == 5


def test_the_angle_of_a_missing_joint_is_nan_and_the_zero_mode_is_hidden():
    chain = named(5)
    model = model_of(chain)
    model.update_joints(joints(chain.joint_names[1:], chain.chain.uniform_state(1)[1:]))
    _, arrays = shown(model)
    assert np.isnan(arrays['angles']).tolist() == [True, False, False, False, False]
    assert not len(arrays['mode'])
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    assert len(shown(model)[1]['mode']) == 5


def test_joints_of_another_chain_are_rejected():
    chain = named(5)
    model = model_of(chain)
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    model.update_joints(joints(('wheel',), np.array([1.0])))
    assert "none of the 5 rotors, such as 'rotor_0'" in model.error
    assert shown(model)[0]['rotors'] == 5
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(-1)))
    assert model.error == ''


def test_a_frame_of_a_long_chain_contains_a_limited_number_of_rotors():
    chain = named(10_000)
    model = model_of(chain)
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    assert not len(shown(model)[1]['angles'])
    assert len(shown(model)[1]['overview']) == 2048
    numbers, arrays = unpack(model.packed(0, 4000, 4100))
    assert numbers['first'] == 4000
    assert len(arrays['angles']) == 101
    for window in ((-50, 20), (9990, 20_000), (500, 2), (2**70, -(2**70))):
        frame = model.packed(0, *window)
        assert len(frame) < 4 * (2048 + 3 * MOST_ANGLES) + 1000


def test_groups_keep_the_smallest_and_the_largest_lean():
    lean = np.random.default_rng(1).normal(size=7777)
    grouped = overview(lean).reshape(-1, 2)
    assert grouped.min() == pytest.approx(lean.min())
    assert grouped.max() == pytest.approx(lean.max())
    assert (grouped[:, 0] <= grouped[:, 1]).all()
    np.testing.assert_allclose(overview(lean[:2048]), lean[:2048], rtol=1e-6)


def test_the_history_has_a_limited_size():
    clock, chain = Clock(), named(3000)
    model = model_of(chain, clock)
    frame = chain.chain.uniform_state(1)
    for second in range(400):
        clock.now += 1.0
        model.update_joints(joints(chain.joint_names, frame, second))
    assert sum(len(column.overview) for column in model.history) <= 400_000


def test_the_rate_is_measured_from_sequence_numbers():
    clock = Clock()
    model = ChainModel(clock)
    for second in range(4):
        model.update_rate(1000 + 500 * second)
        clock.now += 1.001
    assert model.rate == pytest.approx(500, rel=0.01)
    model.update_rate(3)
    clock.now += 2.0
    model.update_rate(23)
    assert model.rate == pytest.approx(10)


def test_a_state_is_shown_until_the_analyser_is_silent():
    clock, chain = Clock(), named(5)
    model = model_of(chain, clock)
    model.update_state({'rotor': 2.25, 'kinetic': 7.0}, [2.25, 0.01, 1.0])
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    numbers, arrays = shown(model)
    assert (numbers['rotor'], numbers['kinetic']) == (2.25, 7.0)
    np.testing.assert_allclose(arrays['solitons'], [2.25, 0.01, 1.0])
    clock.now += 5.0
    model.update_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    numbers, arrays = shown(model)
    assert math.isnan(numbers['rotor'])
    assert numbers['kinetic'] == 0.0
    assert not len(arrays['solitons'])


def test_the_delay_is_the_age_of_the_state_relative_to_the_angles():
    clock, chain = Clock(), named(4)
    model = model_of(chain, clock)
    angles = chain.chain.uniform_state(1)
    model.update_joints(joints(chain.joint_names, angles, 5))
    assert math.isnan(model.delay)
    assert shown(model)[0]['state_stamp'] == 5.0
    model.update_state({'state_stamp': 4.5, 'rotor': 1.5}, [1.5, 0.0, 1.0])
    assert model.delay == 0.5
    assert shown(model)[0]['state_stamp'] == 4.5
    clock.now += 2.0
    assert math.isnan(model.delay)
