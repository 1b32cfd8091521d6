# SPDX-License-Identifier: Apache-2.0
"""A parameter file describes a chain and its joints, or it is said what is wrong with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.programs.chain_file import chain_of_file

CONFIG = Path(__file__).parents[3] / 'config'


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        ('just words', 'is no file of parameters'),
        ('/**: {ros__parameters: {chain.weight: 1.0}}', 'chain.weight is unknown; known: '),
        ('/**: {ros__parameters: {chain.mass: -1.0}}', 'mass = -1.0 must lie in the range'),
        (
            '/**: {ros__parameters: {chain.number_of_rotors: 3, joint_names: [a, b]}}',
            'joint_names has 2 names for 3 rotors; name one joint a rotor',
        ),
    ],
)
def test_a_file_that_describes_no_chain_is_refused(
    tmp_path: Path, content: str, complaint: str
) -> None:
    path = tmp_path / 'chain.yaml'
    path.write_text(content)
    with pytest.raises(ValueError, match=complaint):
        chain_of_file(path)


def test_a_file_may_name_the_joints(tmp_path: Path) -> None:
    path = tmp_path / 'chain.yaml'
    path.write_text(
        'soliton_analyser:\n  ros__parameters:\n    chain.number_of_rotors: 2\n'
        '    joint_names: [left, right]\n    noise: 0.1\n'
    )
    chain = replace(Chain(), number_of_rotors=2)
    assert chain_of_file(path) == NamedChain(chain, ('left', 'right'))


def test_the_file_of_all_parameters_describes_the_chain_that_nodes_have_by_themselves() -> None:
    named = chain_of_file(CONFIG / 'linkage.yaml')
    assert named == NamedChain(Chain(), default_joint_names(Chain().number_of_rotors))


def test_a_file_may_hold_deviations_and_groups_of_parameters(tmp_path: Path) -> None:
    path = tmp_path / 'chain.yaml'
    path.write_text(
        'left:\n  simulator:\n    ros__parameters:\n      chain:\n'
        '        number_of_rotors: 2\n        deviations: {mass: [0.0, 0.5]}\n'
    )
    chain = chain_of_file(path).chain
    assert (chain.number_of_rotors, chain.deviations.mass) == (2, (0.0, 0.5))
