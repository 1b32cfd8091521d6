# SPDX-License-Identifier: Apache-2.0
"""Parameter file of an identified chain, which every node of the suite accepts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.identification.result import Identification
from soliton_linkage_nodes.messages.conversions import default_joint_names

_NODES = ('edge_actuator', 'soliton_analyser', 'soliton_steering', 'visualisation')
"""Nodes for which the file sets the parameter `chain_from`."""
_PARAMETERS = ('spacing', 'rotor_length', 'rest_angle', 'mass', 'stiffness', 'damping')
_MEANINGS = {
    'spacing': 'distances from each rotor to the next',
    'rotor_length': 'lengths of the rotors',
    'rest_length': 'lengths of the springs or bars',
    'mass': 'masses',
    'stiffness': 'stiffnesses',
    'damping': 'damping coefficients',
}


def write_parameters(
    found: Identification, joint_names: Sequence[str], source: str, path: Path
) -> None:
    """Write the parameter file of an identified chain.

    `source` contains the names of the bags, or the name of the node that has identified the chain.
    The first line of the file is a comment with this text.
    """
    path.write_text('\n'.join(_lines(found, joint_names, source)) + '\n', encoding='utf-8')


def _lines(found: Identification, joint_names: Sequence[str], source: str) -> Iterator[str]:
    chain = found.chain
    yield f'# Chain identified by {source}.'
    yield '# The line above each list of relative deviations gives their standard deviations [1].'
    yield from (f'# {line}' for line in found.warnings)
    usual = tuple(joint_names) == default_joint_names(chain.number_of_rotors)
    for node in _NODES:
        yield from (f'/**/{node}:', '  ros__parameters:', '    chain_from: parameters')
        if not usual:
            yield f'    joint_names: [{", ".join(map(repr, joint_names))}]'
    yield from ('', '/**:', '  ros__parameters:')
    yield f'    chain.number_of_rotors: {chain.number_of_rotors}'
    if found.mass_deviation > 0:
        yield f'    # mass, from impulses; relative standard deviation {found.mass_deviation:.6f}'
    if found.damping_deviation > 0:
        yield f'    # damping; standard deviation {found.damping_deviation:.3g}'
    if found.friction_deviation > 0:
        yield f'    # in addition, dry friction of {found.friction:.3g} N m;'
        yield f'    # standard deviation {found.friction_deviation:.2g} N m'
    if found.spacing_deviation > 0:
        deviation = f'{found.spacing_deviation:.6f}'
        yield f'    # spacing, from gravity; relative standard deviation {deviation}'
    yield from (f'    chain.{name}: {getattr(chain, name)!r}' for name in _PARAMETERS)
    for name, meaning in _MEANINGS.items():
        fractions = getattr(chain.deviations, name)
        if fractions:
            if name in found.deviations:
                yield f'    # {meaning}; standard deviations {_list(found.deviations[name])}'
            yield f'    chain.deviations.{name}: {_list(fractions)}'
    yield f'    # offsets [rad]; standard deviations {_list(found.offset_deviations)}'
    yield f'    chain.encoders.offsets: {_list(found.offsets)}'


def _list(values: ArrayLike) -> str:
    return f'[{", ".join(f"{value:.6f}" for value in np.asarray(values).tolist())}]'
