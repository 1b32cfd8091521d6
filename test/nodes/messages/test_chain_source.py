# SPDX-License-Identifier: Apache-2.0
"""A node learns the chain from the latched topic, early or late, or from its parameters."""

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from graphs import values

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Disorder
from soliton_linkage_nodes.messages.chain_source import ChainSource, chain_of_file
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.stamps import time_to_msg


class Learner(GuardedNode):
    """Node that needs the chain."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('learner', **kwargs)
        self.learnt: list[NamedChain] = []
        diagnostics = Diagnostics(self, 'learning', lambda: Report('here'))
        self.source = ChainSource(self, diagnostics, self.learnt.append)


def test_nodes_receive_the_chain_before_and_after_it_is_published(graph, named):
    early = graph.start(Learner)
    assert early.source.named is None
    interfaces.CHAIN.publisher(graph.user).publish(chain_to_msg(named, time_to_msg(0)))
    late = graph.start(Learner)
    for learner in (early, late):
        graph.until(lambda learner=learner: learner.learnt, 'the chain')
        assert learner.learnt == [named]
        assert learner.source.named == named


def test_offsets_are_those_of_the_chain_unless_parameters_know_others(graph, named):
    told, own = (
        dataclasses.replace(named, encoder_offsets=(x,) * named.rotors) for x in (0.2, 0.1)
    )
    given = {
        'chain.number_of_rotors': named.rotors,
        'chain.encoders.offsets': list(own.encoder_offsets),
    }
    learners = graph.start(Learner), graph.start(Learner, given)
    graph.speak(interfaces.CHAIN, 2).publish(chain_to_msg(told, time_to_msg(0)))
    graph.until(lambda: all(each.learnt for each in learners), 'the chain')
    assert [each.learnt for each in learners] == [[told], [own]]


def test_a_chain_that_changes_is_logged_once(graph, named, said):
    learner = graph.start(Learner)
    publisher = graph.speak(interfaces.CHAIN)
    other = NamedChain(Chain(number_of_rotors=2, mass=1.0), ('left', 'right'))
    for number, chain in enumerate((named, named, other, other), start=1):
        publisher.publish(chain_to_msg(chain, time_to_msg(0)))
        graph.until(lambda number=number: len(learner.learnt) == number, 'the chain')
    assert learner.learnt == [named, named, other, other]
    lines = said().splitlines()
    (first,) = [line for line in lines if '/chain describes a chain of 8 rotors (flipper' in line]
    assert 'changed' not in first
    (change,) = [line for line in lines if 'the chain has changed' in line]
    assert (
        "2 rotors (flipper, a = 0.1 m, r = 0.05 m, rest angle 0.97 rad), joints 'left'" in change
    )
    assert 'the chain has changed (number_of_rotors, mass); it was a chain of 8 rotors' in change


def test_a_message_that_describes_no_chain_changes_nothing(graph, named):
    learner = graph.start(Learner)
    publisher = graph.speak(interfaces.CHAIN)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    graph.until(lambda: learner.learnt, 'the chain')
    wrong = chain_to_msg(named, time_to_msg(0))
    wrong.spacing = float('nan')
    heard = graph.reports('learner')
    publisher.publish(wrong)
    graph.until(lambda: heard and values(heard[-1])['rejected'] == '1', 'the refusal')
    assert 'spacing = nan must be a finite number' in values(heard[-1])['last rejection']
    assert learner.learnt == [named]


def test_parameters_replace_the_topic(graph):
    given = {'chain_from': 'parameters', 'chain.number_of_rotors': 3, 'chain.mass': 0.5}
    learner = graph.start(Learner, given)
    chain = Chain(number_of_rotors=3, mass=0.5)
    assert learner.learnt == [NamedChain(chain, default_joint_names(3))]
    assert graph.user.count_subscribers(interfaces.CHAIN.name) == 0


def test_parameters_of_disorder_draw_the_chain_that_the_same_seed_draws(graph):
    given = {
        'chain_from': 'parameters',
        'chain.number_of_rotors': 6,
        'chain.periodic': True,
        'chain.damping': 1e-5,
        'chain.disorder.mass': 0.1,
        'chain.disorder.seed': 3,
        'chain.deviations.spacing': [0.01] * 6,
    }
    learner = graph.start(Learner, given)
    drawn = Disorder(mass=0.1, seed=3).drawn(6, periodic=True)
    deviations = dataclasses.replace(drawn, spacing=(0.01,) * 6)
    expected = Chain(6, damping=1e-5, periodic=True, deviations=deviations)
    assert learner.source.named is not None
    assert learner.source.named.chain == expected


def test_parameters_that_describe_no_chain_stop_the_node(graph):
    for given, complaint in [
        (
            {'chain.disorder.mass': 0.1, 'chain.deviations.mass': [0.1] * 40},
            'deviations of mass are given twice',
        ),
        ({'chain.deviations.mass': [0.1] * 3}, '3 deviations of mass do not fit a chain of 40'),
        ({'chain.disorder.mass': 0.6}, 'must lie in the range 0 to 0.5'),
        ({'chain.damping': -1.0}, 'must lie in the range 0 to 1e'),
        ({'chain.encoders.offsets': [0.1] * 3}, '3 offsets of encoders do not fit a chain of 40'),
        ({'chain.encoders.offsets': [float('nan')] * 40}, 'offset of rotor 0 = nan rad must lie'),
        (
            {'chain.periodic': True, 'chain.number_of_rotors': 5},
            'must be even if the ends are periodic',
        ),
    ]:
        with pytest.raises(ValueError, match=complaint):
            graph.start(Learner, given)


CONFIG = Path(__file__).parents[3] / 'config'


def test_a_file_that_describes_no_chain_is_rejected(tmp_path):
    for content, complaint in [
        ('just words', 'is no parameter file'),
        ('/**: {ros__parameters: {chain.weight: 1.0}}', 'chain.weight is unknown; known: '),
        ('/**: {ros__parameters: {chain.mass: -1.0}}', 'mass = -1.0 must lie in the range'),
        (
            '/**: {ros__parameters: {chain.number_of_rotors: 3, joint_names: [a, b]}}',
            'joint_names has 2 names for 3 rotors; give one name for each rotor',
        ),
    ]:
        path = tmp_path / 'chain.yaml'
        path.write_text(content)
        with pytest.raises(ValueError, match=complaint):
            chain_of_file(path)


def test_a_file_may_name_the_joints(tmp_path):
    path = tmp_path / 'chain.yaml'
    path.write_text(
        'soliton_analyser:\n  ros__parameters:\n    chain.number_of_rotors: 2\n'
        '    joint_names: [left, right]\n    noise: 0.1\n'
    )
    chain = replace(Chain(), number_of_rotors=2)
    assert chain_of_file(path) == NamedChain(chain, ('left', 'right'))


def test_the_file_of_all_parameters_describes_the_chain_that_nodes_have_by_themselves():
    named = chain_of_file(CONFIG / 'linkage.yaml')
    assert named == NamedChain(Chain(), default_joint_names(Chain().number_of_rotors))


def test_a_file_may_hold_deviations_and_groups_of_parameters(tmp_path):
    path = tmp_path / 'chain.yaml'
    path.write_text(
        'left:\n  simulator:\n    ros__parameters:\n      chain:\n'
        '        number_of_rotors: 2\n        deviations: {mass: [0.0, 0.5]}\n'
    )
    chain = chain_of_file(path).chain
    assert (chain.number_of_rotors, chain.deviations.mass) == (2, (0.0, 0.5))
