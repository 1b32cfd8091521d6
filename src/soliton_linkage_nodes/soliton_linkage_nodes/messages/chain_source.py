# SPDX-License-Identifier: Apache-2.0
"""Where a node learns the chain from: the topic of a simulator, or its own parameters."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from rclpy.node import Node

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS, Deviations, Disorder
from soliton_linkage.linkage.encoders import KnownEncoders
from soliton_linkage.linkage.quantities import described_fields, quantity
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_from_msg,
    check_names,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameter_files import read_sections
from soliton_linkage_nodes.runtime.parameters import declare
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription

Group = TypeVar('Group')


@dataclass(frozen=True)
class ChainSourceParameters:
    """Which of the two it is."""

    chain_from: str = quantity(
        'topic',
        'whether the chain is learnt from the topic chain or from the parameters chain.*',
        choices=('topic', 'parameters'),
    )
    joint_names: tuple[str, ...] = quantity(
        (), 'names of the joints, rotor 0 first; empty for those that the chain has'
    )


@dataclass(frozen=True)
class OptionalChainSourceParameters(ChainSourceParameters):
    """The same of a node that can do without."""

    chain_from: str = quantity(
        'topic',
        'whether the chain is learnt from the topic chain, from the parameters chain.*, or is '
        'not known',
        choices=('topic', 'parameters', 'nowhere'),
    )


CHAIN_PARAMETERS: dict[type, str] = {
    Chain: 'chain.',
    Deviations: 'chain.deviations.',
    Disorder: 'chain.disorder.',
    KnownEncoders: 'chain.encoders.',
}
"""The prefix of the parameters that describe a chain, by the dataclass of their values."""


def declare_chain(node: Node) -> NamedChain:
    """Declare the parameters `chain.*` and return the chain, whose joints have their usual names.

    Raises ValueError where they describe none.
    """
    return chain_of(lambda kind: declare(node, kind, CHAIN_PARAMETERS[kind]))


def chain_of(read: Callable[[Any], Any]) -> NamedChain:
    """Chain with its deviations and encoders, each dataclass of `CHAIN_PARAMETERS` being read."""
    chain: Chain = read(Chain)
    given: Deviations = read(Deviations)
    disorder: Disorder = read(Disorder)
    encoders: KnownEncoders = read(KnownEncoders)
    drawn = disorder.drawn(chain.number_of_rotors, chain.periodic)
    chain = dataclasses.replace(chain, deviations=given.joined(drawn))
    return NamedChain(chain, default_joint_names(chain.number_of_rotors), encoders.offsets)


def describe_chain(chain: Chain) -> str:
    """A chain in a few words, such as its number of rotors and its class of motion."""
    shape = 'a ring' if chain.periodic else 'a chain'
    alike = '' if chain.deviations == NO_DEVIATIONS else ', with deviations'
    return (
        f'{shape} of {chain.number_of_rotors} rotors ({chain.motion.value}, '
        f'a = {chain.spacing:g} m, r = {chain.rotor_length:g} m, '
        f'rest angle {chain.rest_angle:g} rad{alike})'
    )


def declare_chain_source(
    node: Node, parameters: type[ChainSourceParameters] = ChainSourceParameters
) -> None:
    """Declare the parameters of a `ChainSource`; ValueError where they describe no chain."""
    check_names('parameter joint_names', declare(node, parameters).joint_names)
    declare_chain(node)


class ChainSource:
    """The chain that a node works on; None until it is known."""

    def __init__(
        self,
        node: GuardedNode,
        diagnostics: Diagnostics,
        learnt: Callable[[NamedChain], None] = lambda named: None,
        parameters: type[ChainSourceParameters] = ChainSourceParameters,
    ) -> None:
        """Read the parameters or listen to the topic; `learnt` is called with each chain.

        The node says which chain it learns from the topic, and when that is another one.

        Raises ValueError where the parameters describe no chain.
        """
        self.named: NamedChain | None = None
        self._subscription: StreamSubscription | None = None
        self._logger = node.get_logger()
        self._topic = node.resolve_topic_name(interfaces.CHAIN.name)
        self._learnt = learnt
        self.parameters = declare(node, parameters)
        check_names('parameter joint_names', self.parameters.joint_names)
        given = declare_chain(node)
        self._encoder_offsets = given.encoder_offsets
        if self.parameters.chain_from == 'parameters':
            self._learn(given)
        elif self.parameters.chain_from == 'topic':
            take = diagnostics.guarded('chain', self._on_chain)
            self._subscription = StreamSubscription(node, interfaces.CHAIN, take, diagnostics)

    @property
    def description(self) -> str:
        """Which chain it is, or where it will come from."""
        if self.named is not None:
            return describe_chain(self.named.chain)
        known = self.parameters.chain_from == 'topic'
        return f'the chain of {self._topic}' if known else 'a chain that is not known'

    def resubscribe(self) -> None:
        """Hear the chain again: another has taken the place of who told it."""
        if self._subscription is not None:
            self._subscription.resubscribe()

    def _on_chain(self, message: msg.Chain) -> None:
        before = self.named
        self._learn(chain_from_msg(message))
        if self.named == before or self.named is None:
            return
        told = f'{self._topic} tells of {describe_chain(self.named.chain)}'
        if before is None:
            self._logger.info(told)
        else:
            self._logger.warning(
                f'{told}, named {self.named.joint_names[0]!r} to {self.named.joint_names[-1]!r}: '
                f'the chain has changed, it was {describe_chain(before.chain)}'
            )

    def _learn(self, named: NamedChain) -> None:
        joints = self.parameters.joint_names
        if joints and len(joints) != named.rotors:
            raise ValueError(
                f'parameter joint_names has {len(joints)} names for a chain of {named.rotors} '
                'rotors; name one joint a rotor'
            )
        names = joints or named.joint_names
        offsets = self._encoder_offsets or named.encoder_offsets
        self.named = NamedChain(named.chain, names, offsets)
        self._learnt(self.named)


_LONGEST_VALUE = 40
"""Longest value that is printed [characters]: those of many rotors are lists of thousands."""


class ParameterFile:
    """Values of a parameter file by their name, for whatever nodes they are."""

    def __init__(self, path: Path) -> None:
        """Read it; ValueError if it is no parameter file."""
        self.path = path
        try:
            sections = read_sections(path).values()
        except (OSError, ValueError) as error:
            remedy = 'give a parameter file such as config/flipper.yaml'
            raise ValueError(f'{error}; {remedy}') from error
        self.values = {name: value for held in sections for name, value in held.items()}

    def read(self, kind: type[Group], prefix: str) -> Group:
        """Return the values with a prefix in a dataclass, with its defaults for the others."""
        given = {name: self.values.get(prefix + name) for name in described_fields(kind)}
        values = {name: value for name, value in given.items() if value is not None}
        return kind(**{n: tuple(v) if isinstance(v, list) else v for n, v in values.items()})

    def check(self, prefix: str, groups: Mapping[type, str]) -> None:
        """Raise ValueError for a name with a prefix that is in none of the dataclasses."""
        known = {
            before + name for kind, before in groups.items() for name in described_fields(kind)
        }
        unknown = sorted(
            each for each in self.values if each.startswith(prefix) and each not in known
        )
        if unknown:
            raise ValueError(
                f'{self.path}: {unknown[0]} is unknown; known: {", ".join(sorted(known))}'
            )


def chain_of_file(path: Path) -> NamedChain:
    """Return the chain of a parameter file, by its chain.* and joints; ValueError for none."""
    file = ParameterFile(path)
    file.check('chain.', CHAIN_PARAMETERS)
    named = chain_of(lambda kind: file.read(kind, CHAIN_PARAMETERS[kind]))
    joints = tuple(file.values.get('joint_names', ())) or named.joint_names
    check_names(f'{path}: joint_names', joints)
    if len(joints) != named.rotors:
        raise ValueError(
            f'{path}: joint_names has {len(joints)} names for {named.rotors} rotors; '
            'name one joint a rotor'
        )
    return replace(named, joint_names=joints)


def markers_of_file(path: Path) -> MarkerSettings:
    """Return the printed markers of a parameter file; ValueError for an unknown markers.*."""
    file = ParameterFile(path)
    file.check('markers.', {MarkerSettings: 'markers.'})
    settings = file.read(MarkerSettings, 'markers.')
    return MarkerLayout(chain_of_file(path).chain, settings).as_printed


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
