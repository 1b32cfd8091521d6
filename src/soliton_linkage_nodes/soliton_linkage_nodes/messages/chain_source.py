# SPDX-License-Identifier: Apache-2.0
"""Chain descriptions from the topic `chain`, from parameters of a node or from a file."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rclpy.node import Node

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS, Deviations, Disorder
from soliton_linkage.linkage.encoders import KnownEncoders
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.linkage.quantities import described_fields, quantity
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_from_msg,
    chain_to_msg,
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
    """Choice of the source of the chain description, and the joint names."""

    chain_from: str = quantity(
        'topic',
        'source of the chain: the topic chain or the parameters chain.*',
        choices=('topic', 'parameters'),
    )
    joint_names: tuple[str, ...] = quantity(
        (), 'names of the joints, rotor 0 first; empty for the names in the chain'
    )


@dataclass(frozen=True)
class OptionalChainSourceParameters(ChainSourceParameters):
    """Choice of the source for a node that can also work while the chain is unknown."""

    chain_from: str = quantity(
        'topic',
        'source of the chain: the topic chain, the parameters chain.*, or nowhere if the chain is '
        'unknown',
        choices=('topic', 'parameters', 'nowhere'),
    )


CHAIN_PARAMETERS: dict[type, str] = {
    Chain: 'chain.',
    Feedback: 'chain.feedback.',
    Deviations: 'chain.deviations.',
    Disorder: 'chain.disorder.',
    KnownEncoders: 'chain.encoders.',
}
CHAIN_SOURCE_PARAMETERS: dict[type, str] = {ChainSourceParameters: '', **CHAIN_PARAMETERS}


def declare_chain(node: Node) -> NamedChain:
    """Declare the parameters `chain.*` and return the chain that they describe.

    Raises ValueError if the chain is invalid.
    """
    return chain_of(lambda kind: declare(node, kind, CHAIN_PARAMETERS[kind]))


def chain_of(read: Callable[[Any], Any]) -> NamedChain:
    """Return the chain that parameters describe.

    `read` takes a class of parameters and returns an instance with the values of the parameters.
    """
    chain: Chain = read(Chain)
    given: Deviations = read(Deviations)
    disorder: Disorder = read(Disorder)
    encoders: KnownEncoders = read(KnownEncoders)
    drawn = disorder.drawn(chain.number_of_rotors, chain.periodic)
    chain = replace(chain, deviations=given.joined(drawn), feedback=read(Feedback))
    return NamedChain(chain, default_joint_names(chain.number_of_rotors), encoders.offsets)


def describe_chain(chain: Chain) -> str:
    """Describe a chain by its number of rotors, motion, spacing, rotor length and rest angle.

    The motion is flipper, wobbling flipper or spinner.
    """
    shape = 'a ring' if chain.periodic else 'a chain'
    deviations = '' if chain.deviations == NO_DEVIATIONS else ', with deviations'
    return (
        f'{shape} of {chain.number_of_rotors} rotors ({chain.motion.value}, '
        f'a = {chain.spacing:g} m, r = {chain.rotor_length:g} m, '
        f'rest angle {chain.rest_angle:g} rad{deviations})'
    )


def declare_chain_source(node: Node) -> None:
    """Declare the parameters of a `ChainSource`.

    Raises ValueError if they describe an invalid chain or if a joint name occurs twice.
    """
    check_names('parameter joint_names', declare(node, ChainSourceParameters).joint_names)
    declare_chain(node)


class ChainSource:
    """Current chain of a node, from the topic `chain` or from parameters."""

    def __init__(
        self,
        node: GuardedNode,
        diagnostics: Diagnostics,
        on_chain: Callable[[NamedChain], None] = lambda named: None,
        parameters: type[ChainSourceParameters] = ChainSourceParameters,
    ) -> None:
        """Read the chain from the parameters, or subscribe to the topic `chain`.

        Raises ValueError if a parameter is invalid.
        """
        self.named: NamedChain | None = None
        self._subscription: StreamSubscription | None = None
        self._node, self._logger = node, node.get_logger()
        self._topic = node.resolve_topic_name(interfaces.CHAIN.name)
        self._callback = on_chain
        self.parameters = declare(node, parameters)
        check_names('parameter joint_names', self.parameters.joint_names)
        given = declare_chain(node)
        self._encoder_offsets = given.encoder_offsets
        if self.parameters.chain_from == 'parameters':
            self._set(given)
        elif self.parameters.chain_from == 'topic':
            take = diagnostics.guarded('chain', self._on_chain)
            self._subscription = StreamSubscription(node, interfaces.CHAIN, take, diagnostics)

    @property
    def description(self) -> str:
        """Text that describes the chain or, while the chain is unknown, names the source."""
        if self.named is not None:
            return describe_chain(self.named.chain)
        known = self.parameters.chain_from == 'topic'
        return f'the chain of {self._topic}' if known else 'an unknown chain'

    def publish_parameters(self) -> None:
        """Publish the chain on the topic `chain` if it was read from parameters."""
        if self.parameters.chain_from == 'parameters' and self.named is not None:
            stamp = self._node.get_clock().now().to_msg()
            interfaces.CHAIN.publisher(self._node).publish(chain_to_msg(self.named, stamp))

    def resubscribe(self) -> None:
        """Subscribe again in order to receive the latched chain of a new publisher."""
        if self._subscription is not None:
            self._subscription.resubscribe()

    def _on_chain(self, message: msg.Chain) -> None:
        before = self.named
        self._set(chain_from_msg(message))
        if self.named == before or self.named is None:
            return
        text = f'{self._topic} describes {describe_chain(self.named.chain)}'
        if before is None:
            self._logger.info(text)
        else:
            old, new = before.chain, self.named.chain
            names = [f.name for f in fields(Chain) if getattr(old, f.name) != getattr(new, f.name)]
            self._logger.warning(
                f'{text}, joints {self.named.joint_names[0]!r} to {self.named.joint_names[-1]!r}: '
                f'the chain has changed ({", ".join(names) or "joints"}); '
                f'it was {describe_chain(old)}'
            )

    def _set(self, named: NamedChain) -> None:
        offsets = self._encoder_offsets or named.encoder_offsets
        named = with_joints(named, self.parameters.joint_names)
        self.named = replace(named, encoder_offsets=offsets)
        self._callback(self.named)


def with_joints(
    named: NamedChain, joints: tuple[str, ...], source: str = 'parameter joint_names'
) -> NamedChain:
    """Return the chain with the joint names `joints`; without names, return `named` unchanged.

    Raises ValueError if the number of names is wrong. `source` is the name of the list in the
    error text.
    """
    if joints and len(joints) != named.rotors:
        raise ValueError(
            f'{source} has {len(joints)} names for {named.rotors} rotors; give one name for each '
            'rotor'
        )
    return replace(named, joint_names=joints or named.joint_names)


_LONGEST_VALUE = 40
"""Largest length of the text of a value [characters]; longer texts are cut."""


class ParameterFile:
    """Parameter file. `values` maps the parameter names of all nodes in the file to values."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            sections = read_sections(path).values()
        except (OSError, ValueError) as error:
            remedy = 'give a parameter file such as config/flipper.yaml'
            raise ValueError(f'{error}; {remedy}') from error
        self.values = {name: value for held in sections for name, value in held.items()}

    def read(self, kind: type[Group], prefix: str) -> Group:
        """Return an instance of the dataclass `kind` with values from the file.

        The value of a field is the parameter whose name is `prefix` plus the name of the field. A
        field whose parameter is not in the file has its default.
        """
        given = {name: self.values.get(prefix + name) for name in described_fields(kind)}
        values = {name: value for name, value in given.items() if value is not None}
        return kind(**{n: tuple(v) if isinstance(v, list) else v for n, v in values.items()})

    def check(self, prefix: str, groups: Mapping[type, str]) -> None:
        """Raise ValueError if the file has an unknown parameter whose name begins with `prefix`.

        `groups` maps the dataclasses of known parameters to the prefixes of their names.
        """
        known = {
            before + name for kind, before in groups.items() for name in described_fields(kind)
        }
        unknown = sorted(each for each in self.values.keys() - known if each.startswith(prefix))
        if unknown:
            listed = ', '.join(sorted(known))
            raise ValueError(f'{self.path}: {unknown[0]} is unknown; known: {listed}')


def chain_of_file(path: Path) -> NamedChain:
    """Return the chain in a parameter file. Raises ValueError if file or chain is invalid."""
    file = ParameterFile(path)
    file.check('chain.', CHAIN_PARAMETERS)
    named = chain_of(lambda kind: file.read(kind, CHAIN_PARAMETERS[kind]))
    source, joints = f'{path}: joint_names', tuple(file.values.get('joint_names', ()))
    check_names(source, joints)
    return with_joints(named, joints, source)


def markers_of_file(path: Path) -> MarkerSettings:
    """Return the marker settings in a parameter file. Raises ValueError for an unknown setting."""
    file = ParameterFile(path)
    file.check('markers.', {MarkerSettings: 'markers.'})
    settings = file.read(MarkerSettings, 'markers.')
    return MarkerLayout(chain_of_file(path).chain, settings).as_printed


def differences(one: NamedChain, other: NamedChain) -> str:
    """Describe the parameters in which two chains differ, with both values of each parameter."""
    names = [field.name for field in fields(Chain)]
    pairs = [(name, getattr(one.chain, name), getattr(other.chain, name)) for name in names]
    pairs.append(('joint_names', one.joint_names, other.joint_names))
    short = partial(textwrap.shorten, width=_LONGEST_VALUE, placeholder=' ...')
    different = [(name, short(str(a)), short(str(b))) for name, a, b in pairs if a != b]
    return ', '.join(f'{name} {a} for {b}' for name, a, b in different)
