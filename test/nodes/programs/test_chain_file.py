# SPDX-License-Identifier: Apache-2.0
"""A parameter file describes a chain and its joints, or it is said what is wrong with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.programs.chain_file import chain_of_file


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        ('just words', 'is no parameter file'),
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
