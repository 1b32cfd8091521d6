# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_nodes.live_view.chain_model import MOST_ANGLES, ChainModel, overview
from soliton_linkage_nodes.live_view.frame_layout import unpack
from soliton_linkage_nodes.messages.conversions import (
    JointStates,
    NamedChain,
    default_joint_names,
)


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def named(rotors: int) -> NamedChain:
    return NamedChain(Chain(number_of_rotors=rotors), default_joint_names(rotors))


def joints(names: tuple[str, ...], angles: Array, second: int = 5) -> JointStates:
    return JointStates(second, 0, 'linkage', names, angles, np.zeros(len(angles)))


def shown(model: ChainModel, last: int = 10_000) -> tuple[dict[str, float], dict[str, Array]]:
    return unpack(model.picture(0, 0, last))


def test_a_picture_shows_the_chain_as_the_physics_has_it() -> None:
    chain, model = named(12), ChainModel()
    angles = chain.chain.uniform_state(-1) + 0.05 * np.sin(np.arange(12))
    model.learn(chain)
    model.take_joints(joints(chain.joint_names, angles))
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


def test_without_a_chain_it_shows_how_joints_lean_and_nothing_that_it_cannot_know() -> None:
    model = ChainModel()
    model.take_joints(joints(('shoulder', 'elbow'), np.array([0.5, -0.5])))
    numbers, arrays = shown(model)
    np.testing.assert_allclose(arrays['overview'], np.sin([0.5, -0.5]), rtol=1e-6)
    assert not len(arrays['extensions'])
    assert not len(arrays['mode'])
    assert math.isnan(numbers['elastic'])
    assert model.description()['spacing'] is None
    assert model.description()['joints'] == ['shoulder', 'elbow']


def test_a_source_that_stops_grows_old_and_one_that_comes_back_is_young() -> None:
    clock = Clock()
    model, chain = ChainModel(clock), named(4)
    assert model.age == math.inf
    model.learn(chain)
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    clock.now += 1.2
    assert shown(model)[0]['age'] == pytest.approx(1.2)
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1), 7))
    assert shown(model)[0]['age'] == 0.0


def test_another_number_of_rotors_begins_anew() -> None:
    model = ChainModel()
    for rotors in (6, 9, 3):
        names = default_joint_names(rotors)
        version = model.version
        model.take_joints(joints(names, np.zeros(rotors)))
        assert shown(model)[0]['rotors'] == rotors
        assert model.version > version
        assert len(model.history[-1].overview) == rotors
    model.learn(named(5))
    model.take_joints(joints(default_joint_names(5), np.zeros(5)))
    assert shown(model)[0]['rotors'] == 5


def test_a_joint_that_is_missing_is_a_gap_and_hides_the_zero_mode() -> None:
    chain, model = named(5), ChainModel()
    model.learn(chain)
    model.take_joints(joints(chain.joint_names[1:], chain.chain.uniform_state(1)[1:]))
    _, arrays = shown(model)
    assert np.isnan(arrays['angles']).tolist() == [True, False, False, False, False]
    assert not len(arrays['mode'])
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    assert len(shown(model)[1]['mode']) == 5


def test_joints_of_another_chain_are_complained_of_and_change_nothing() -> None:
    chain, model = named(5), ChainModel()
    model.learn(chain)
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    model.take_joints(joints(('wheel',), np.array([1.0])))
    assert "none of the 5 rotors, whose first is 'rotor_0'" in model.complaint
    assert shown(model)[0]['rotors'] == 5
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(-1)))
    assert model.complaint == ''


def test_a_long_chain_is_sent_in_parts_that_fit_a_screen() -> None:
    chain, model = named(10_000), ChainModel()
    model.learn(chain)
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    assert not len(shown(model)[1]['angles'])
    assert len(shown(model)[1]['overview']) == 2048
    numbers, arrays = unpack(model.picture(0, 4000, 4100))
    assert numbers['first'] == 4000
    assert len(arrays['angles']) == 101
    for window in ((-50, 20), (9990, 20_000), (500, 2), (2**70, -(2**70))):
        frame = model.picture(0, *window)
        assert len(frame) < 4 * (2048 + 3 * MOST_ANGLES) + 1000


def test_groups_keep_the_least_and_the_largest_lean() -> None:
    lean = np.random.default_rng(1).normal(size=7777)
    grouped = overview(lean).reshape(-1, 2)
    assert grouped.min() == pytest.approx(lean.min())
    assert grouped.max() == pytest.approx(lean.max())
    assert (grouped[:, 0] <= grouped[:, 1]).all()
    np.testing.assert_allclose(overview(lean[:2048]), lean[:2048], rtol=1e-6)


def test_memory_of_the_past_is_bounded_however_long_it_runs() -> None:
    clock = Clock()
    model, chain = ChainModel(clock), named(3000)
    model.learn(chain)
    frame = chain.chain.uniform_state(1)
    for second in range(400):
        clock.now += 1.0
        model.take_joints(joints(chain.joint_names, frame, second))
    assert sum(len(column.overview) for column in model.history) <= 400_000


def test_the_rate_is_told_from_the_numbers_of_messages() -> None:
    clock = Clock()
    model = ChainModel(clock)
    for second in range(4):
        model.count(1000 + 500 * second)
        clock.now += 1.001
    assert model.rate == pytest.approx(500, rel=0.01)
    model.count(3)
    clock.now += 2.0
    model.count(23)
    assert model.rate == pytest.approx(10)


def test_what_an_analyser_says_is_shown_while_it_speaks() -> None:
    clock = Clock()
    model, chain = ChainModel(clock), named(5)
    model.learn(chain)
    model.take_state({'rotor': 2.25, 'kinetic': 7.0}, [2.25, 0.01, 1.0])
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    numbers, arrays = shown(model)
    assert (numbers['rotor'], numbers['kinetic']) == (2.25, 7.0)
    np.testing.assert_allclose(arrays['places'], [2.25, 0.01, 1.0])
    clock.now += 5.0
    model.take_joints(joints(chain.joint_names, chain.chain.uniform_state(1)))
    numbers, arrays = shown(model)
    assert math.isnan(numbers['rotor'])
    assert numbers['kinetic'] == 0.0
    assert not len(arrays['places'])


def test_a_state_that_is_older_than_the_angles_is_told_with_its_stamp() -> None:
    clock = Clock()
    model, chain = ChainModel(clock), named(4)
    model.learn(chain)
    angles = chain.chain.uniform_state(1)
    model.take_joints(joints(chain.joint_names, angles, 5))
    assert math.isnan(model.behind)
    assert shown(model)[0]['state_stamp'] == 5.0
    model.take_state({'state_stamp': 4.5, 'rotor': 1.5}, [1.5, 0.0, 1.0])
    assert model.behind == 0.5
    assert shown(model)[0]['state_stamp'] == 4.5
    clock.now += 2.0
    assert math.isnan(model.behind)
