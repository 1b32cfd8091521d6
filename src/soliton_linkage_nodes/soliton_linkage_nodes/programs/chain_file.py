# SPDX-License-Identifier: Apache-2.0
"""The chain that a parameter file describes."""

from __future__ import annotations

from pathlib import Path

import yaml

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    check_names,
    default_joint_names,
)


def chain_of_file(path: Path) -> NamedChain:
    """Chain of a parameter file, by its chain.* and joints; raises ValueError for none."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        nodes = content.values()
        given = {key: value for node in nodes for key, value in node['ros__parameters'].items()}
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        raise ValueError(
            f'{path} is no parameter file ({error}); give one as config/flipper.yaml'
        ) from error
    known = described_fields(Chain)
    parameters = {
        key.removeprefix('chain.'): value for key, value in given.items() if key[:6] == 'chain.'
    }
    unknown = sorted(parameters.keys() - known)
    if unknown:
        raise ValueError(f'{path}: chain.{unknown[0]} is unknown; known: {", ".join(known)}')
    chain = Chain(**parameters)
    joints = tuple(given.get('joint_names', ())) or default_joint_names(chain.number_of_rotors)
    check_names(f'{path}: joint_names', joints)
    if len(joints) != chain.number_of_rotors:
        raise ValueError(
            f'{path}: joint_names has {len(joints)} names for {chain.number_of_rotors} rotors; '
            'name one joint a rotor'
        )
    return NamedChain(chain, joints)
