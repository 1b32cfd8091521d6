# SPDX-License-Identifier: Apache-2.0
"""The chain and the markers of a parameter file."""

from __future__ import annotations

import textwrap
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS, chain_of
from soliton_linkage_nodes.messages.conversions import NamedChain, check_names
from soliton_linkage_nodes.runtime.parameter_files import read_sections

_PREFIX = 'markers.'
_LONGEST_VALUE = 40
"""Characters of a value that is told: those of many rotors are lists of thousands."""


def chain_of_file(path: Path) -> NamedChain:
    """Chain of a parameter file, by its chain.* and joints; raises ValueError for none."""
    try:
        sections = read_sections(path)
    except (OSError, ValueError) as error:
        raise ValueError(f'{error}; give a parameter file such as config/flipper.yaml') from error
    given = {name: value for held in sections.values() for name, value in held.items()}
    known = {
        prefix + name
        for kind, prefix in CHAIN_PARAMETERS.items()
        for name in described_fields(kind)
    }
    unknown = sorted(name for name in given if name.startswith('chain.') and name not in known)
    if unknown:
        raise ValueError(f'{path}: {unknown[0]} is unknown; known: {", ".join(sorted(known))}')

    def read(kind: Any) -> Any:
        names = {name: CHAIN_PARAMETERS[kind] + name for name in described_fields(kind)}
        values = {name: given[full] for name, full in names.items() if full in given}
        return kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})

    named = chain_of(read)
    joints = tuple(given.get('joint_names', ())) or named.joint_names
    check_names(f'{path}: joint_names', joints)
    if len(joints) != named.rotors:
        raise ValueError(
            f'{path}: joint_names has {len(joints)} names for {named.rotors} rotors; '
            'name one joint a rotor'
        )
    return replace(named, joint_names=joints)


def markers_of_file(path: Path) -> MarkerSettings:
    """Return the printed markers of a parameter file; ValueError for an unknown markers.*."""
    given: dict[str, Any] = {
        name.removeprefix(_PREFIX): value
        for held in read_sections(path).values()
        for name, value in held.items()
        if name.startswith(_PREFIX)
    }
    known = described_fields(MarkerSettings)
    for name in given:
        if name not in known:
            raise ValueError(
                f'{path}: {_PREFIX}{name} is unknown; known: {_PREFIX}{{{", ".join(known)}}}'
            )
    values: dict[str, Any] = {
        name: tuple(v) if isinstance(v, list) else v for name, v in given.items()
    }
    return MarkerLayout(chain_of_file(path).chain, MarkerSettings(**values)).as_printed


def differences(one: NamedChain, other: NamedChain) -> str:
    """What of a chain is not that of another, by name, value and the other's value."""
    pairs = [
        (name, getattr(one.chain, name), getattr(other.chain, name))
        for name in (field.name for field in fields(Chain))
    ]
    pairs.append(('joint_names', one.joint_names, other.joint_names))
    return ', '.join(f'{name} {_short(a)} for {_short(b)}' for name, a, b in pairs if a != b)


def _short(value: object) -> str:
    return textwrap.shorten(str(value), _LONGEST_VALUE, placeholder=' ...')
