# SPDX-License-Identifier: Apache-2.0
"""Mistakes of encoders are told once each, and what is right is never called one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from graphs import Graph
from rclpy.node import Node

from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_to_msg,
)
from soliton_linkage_nodes.messages.encoder_watch import EncoderWatch, in_degrees
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

CHAINS = (
    Chain(number_of_rotors=20),
    Chain(number_of_rotors=20, rotor_length=0.1, rest_angle=0.77),
    Chain(number_of_rotors=20, rotor_length=0.2, rest_angle=1.18),
)


def states(chain: Chain) -> list[Array]:
    """States of a chain, of which those of a spinner have turned often."""
    walls = [with_soliton(chain, place, 0.0).angles for place in (1.0, 8.3, 17.0)]
    turned = [angles + 2 * np.pi * np.arange(20) for angles in walls]
    return [chain.uniform_state(-1), chain.uniform_state(1), *walls, *turned]


@pytest.mark.parametrize('chain', CHAINS, ids=lambda chain: chain.motion.name)
@pytest.mark.parametrize('noise', [0.0, 0.05])
def test_degrees_are_told_from_radians(chain: Chain, noise: float) -> None:
    errors = noise * np.random.default_rng(7).standard_normal(20)
    for angles in states(chain):
        assert not in_degrees(angles + errors)
        assert in_degrees(np.rad2deg(angles + errors))


def test_rotors_that_are_not_seen_are_passed_over() -> None:
    angles = np.rad2deg(CHAINS[0].uniform_state(1))
    angles[::5] = np.nan
    assert in_degrees(angles)
    assert not in_degrees(np.full(20, np.nan))
    assert not in_degrees(np.full(20, np.inf))


def test_each_mistake_is_told_once() -> None:
    told: list[str] = []
    watch = EncoderWatch(told.append)
    angles = CHAINS[0].uniform_state(1)
    for stamp in (5, 6, 7, 9):
        watch.look(stamp * SECOND, angles)
    watch.look(2 * SECOND, angles)
    assert told == []
    for stamp in (3 * SECOND, 3 * SECOND, 2 * SECOND + 1, 0, 0):
        watch.look(stamp, angles)
    assert [line.split(';')[0] for line in told] == [
        'joint_states come late: the stamp of one is the same as that of the one before',
        'joint_states have no stamps',
    ]


@pytest.mark.parametrize('create', [SolitonAnalyser, EdgeActuator, SolitonSteering])
def test_the_nodes_tell_of_mistakes(
    graph: Graph, create: Callable[..., Node], said: Callable[[], str]
) -> None:
    chain = replace(Chain(), number_of_rotors=8)
    graph.start(create, {'chain_from': 'parameters', 'chain.number_of_rotors': 8})
    publisher = graph.speak(interfaces.JOINT_STATES)
    angles = np.rad2deg(chain.uniform_state(-1))
    named = NamedChain(chain, default_joint_names(8))
    message = frame_to_msg(named, Frame(angles, None), np.zeros(0), time_to_msg(0))

    def told() -> bool:
        publisher.publish(message)
        return 'look like degrees' in said() and 'have no stamps' in said()

    graph.until(told, 'the warnings')
    assert said().count('look like degrees') == said().count('have no stamps') == 1
