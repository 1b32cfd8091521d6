# SPDX-License-Identifier: Apache-2.0
"""Conversion of chains, joint states, impulses and torques to messages and back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.linkage.encoders import KnownEncoders, check_one_each
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.linkage.quantities import LARGEST_ANGLE
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.runtime.stamps import SECOND

FRAME = 'linkage'
"""Name of the coordinate frame whose x axis runs along the pivots."""
_LARGEST_ANGLE = 1e6
"""Largest angle in a reset request [rad]. Larger angles would have large rounding errors."""
_LARGEST_RATE = 1e6
"""Largest angular velocity in a reset request [rad/s]."""
_CHAIN_FIELDS = tuple(
    f.name for f in fields(Chain) if f.name not in ('number_of_rotors', 'deviations', 'feedback')
)
_FEEDBACK = tuple(f.name for f in fields(Feedback))
_DEVIATIONS = tuple(f.name for f in fields(Deviations))


@dataclass(frozen=True)
class NamedChain:
    """Chain, joint names and encoder offsets, each list in the order of the rotors.

    Raises ValueError if the number of encoder offsets is wrong.
    """

    chain: Chain
    joint_names: tuple[str, ...]
    encoder_offsets: tuple[float, ...] = ()
    """Encoder position minus angle of each rotor [rad]; () if these offsets are unknown."""

    def __post_init__(self) -> None:
        check_one_each(KnownEncoders(self.encoder_offsets).offsets, self.rotors)

    @property
    def rotors(self) -> int:
        """Number of rotors."""
        return self.chain.number_of_rotors

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        """Mapping from joint names to rotor numbers."""
        return {name: rotor for rotor, name in enumerate(self.joint_names)}


@dataclass(frozen=True)
class Frame:
    """Angles [rad] and angular velocities [rad/s] of all rotors at one time.

    `rates` is None if the angular velocities are unknown.
    """

    angles: Array
    rates: Array | None


class JointStates(NamedTuple):
    """Fields of a JointState message, except for the efforts. The arrays may be empty."""

    seconds: int
    nanoseconds: int
    frame_id: str
    name: tuple[str, ...]
    position: Array
    velocity: Array

    @property
    def stamp(self) -> int:
        """Time of the joint states since the epoch [ns]."""
        return self.seconds * SECOND + self.nanoseconds


def default_joint_names(number_of_rotors: int) -> tuple[str, ...]:
    """Return the default joint names `rotor_0`, `rotor_1`, ..."""
    return tuple(f'rotor_{rotor}' for rotor in range(number_of_rotors))


def chain_to_msg(named: NamedChain, stamp: Time) -> msg.Chain:
    """Return the message that describes a chain with its joint names and encoder offsets."""
    chain = named.chain
    deviations = {f'{name}_deviations': getattr(chain.deviations, name) for name in _DEVIATIONS}
    return msg.Chain(
        header=Header(stamp=stamp, frame_id=FRAME),
        joint_names=list(named.joint_names),
        **{name: getattr(chain, name) for name in _CHAIN_FIELDS},
        **{f'feedback_{name}': getattr(chain.feedback, name) for name in _FEEDBACK},
        **deviations,
        encoder_offsets=named.encoder_offsets,
    )


def chain_from_msg(message: msg.Chain) -> NamedChain:
    """Return the chain that a message describes. Raises ValueError if the message is invalid."""
    names = tuple(message.joint_names)
    check_names('chain.joint_names', names)
    parameters = {name: getattr(message, name) for name in _CHAIN_FIELDS}
    given = {name: tuple(getattr(message, f'{name}_deviations')) for name in _DEVIATIONS}
    deviations = Deviations(**given)
    feedback = Feedback(**{name: getattr(message, f'feedback_{name}') for name in _FEEDBACK})
    chain = Chain(len(names), deviations=deviations, feedback=feedback, **parameters)
    return NamedChain(chain, names, tuple(message.encoder_offsets))


def joint_states_from_msg(message: JointState) -> JointStates:
    """Return the joint states of a message."""
    header = message.header
    return JointStates(
        header.stamp.sec,
        header.stamp.nanosec,
        header.frame_id,
        tuple(message.name),
        np.array(message.position, dtype=np.float64),
        np.array(message.velocity, dtype=np.float64),
    )


def frame_to_msg(named: NamedChain, frame: Frame, efforts: Array, stamp: Time) -> JointState:
    """Return a message with the angles and angular velocities of a frame and `efforts` [N m].

    Unlike `frame_from_msg`, this function ignores the encoder offsets.
    """
    rates = np.zeros(0) if frame.rates is None else frame.rates
    return joint_state(named, stamp, position=frame.angles, velocity=rates, effort=efforts)


def joint_state(named: NamedChain, stamp: Time, **arrays: Array) -> JointState:
    """Return joint states with the given fields, for example `position`, each of shape (N,)."""
    header, names = Header(stamp=stamp, frame_id=FRAME), list(named.joint_names)
    fields = {name: array.tolist() for name, array in arrays.items()}
    return JointState(header=header, name=names, **fields)


def frame_from_msg(named: NamedChain, message: JointState | JointStates) -> Frame:
    """Return the angles and angular velocities in a message, in the order of the rotors.

    Known encoder offsets are subtracted from the angles. Raises ValueError if a rotor is missing
    or a value is invalid.
    """
    order = _order(named.joint_names, message.name)
    angles = np.asarray(message.position, dtype=np.float64)
    rates = np.asarray(message.velocity, dtype=np.float64)
    _check_array('joint_states.position', message.name, angles)
    angles = without_offsets(np.array(angles[order]), named.encoder_offsets)
    if not len(rates):
        return Frame(angles, None)
    _check_array('joint_states.velocity', message.name, rates)
    return Frame(angles, np.array(rates[order]))


def without_offsets(positions: Array, encoder_offsets: Sequence[float] | Array) -> Array:
    """Return the positions minus the encoder offsets [rad], shape (N,).

    If `encoder_offsets` is empty, the offsets are unknown and the positions are returned.
    """
    return positions - encoder_offsets if len(encoder_offsets) else positions


def impulses_to_msg(named: NamedChain, impulses: Array, stamp: Time) -> msg.RotorImpulses:
    """Return the message with the angular impulses on all rotors [N m s]."""
    return msg.RotorImpulses(
        header=Header(stamp=stamp, frame_id=FRAME),
        name=list(named.joint_names),
        impulse=impulses.tolist(),
    )


def impulses_from_msg(
    rotors: Mapping[str, int], message: msg.RotorImpulses, largest: float
) -> Array:
    """Return the impulse on each rotor [N m s]. Rotors that the message does not name have 0.

    `rotors` maps joint names to rotor numbers. Raises ValueError if an impulse exceeds `largest`
    [N m s] or if the message is invalid.
    """
    return _by_rotor(rotors, 'rotor_impulses.impulse', message.name, message.impulse, largest)


def state_from_reset(named: NamedChain, request: Any, now: State) -> State:
    """Return the state into which a `Reset.Request` puts a chain in the state `now`.

    The named joints get the requested angles and rates. All other joints keep their angles, and
    their angular velocities become 0. If the request contains no rates, all angular velocities
    become 0. Raises ValueError if the request names an unknown joint, or if an angle or a rate is
    too large or not finite.
    """
    rotors = named.numbers
    remedy = 'reset to smaller angles and rates'
    given = _by_rotor(rotors, 'reset.angle', request.name, request.angle, _LARGEST_ANGLE, remedy)
    rates = np.zeros(named.rotors)
    if len(request.rate):
        rates = _by_rotor(rotors, 'reset.rate', request.name, request.rate, _LARGEST_RATE, remedy)
    angles = now.angles.copy()
    at = [rotors[name] for name in request.name]
    angles[at] = given[at]
    return State(angles, rates)


def torques_to_msg(named: NamedChain, torques: Array, stamp: Time) -> JointState:
    """Return joint states whose efforts are the torques on all rotors [N m]."""
    return joint_state(named, stamp, effort=torques)


def torques_from_msg(rotors: Mapping[str, int], message: JointState, largest: float) -> Array:
    """Return the torque on each rotor [N m]. Rotors that the message does not name have 0.

    `rotors` maps joint names to rotor numbers. Raises ValueError if a torque exceeds `largest`
    [N m] or if the message is invalid.
    """
    return _by_rotor(rotors, 'rotor_torques.effort', message.name, message.effort, largest)


def check_names(source: str, names: Sequence[str]) -> None:
    """Raise ValueError if a name occurs twice. The error text uses `source` to name the list."""
    if len(set(names)) != len(names):
        twice = next(name for name in names if list(names).count(name) > 1)
        raise ValueError(f'{source} has {twice!r} twice; name each joint once')


def _order(joint_names: Sequence[str], names: Sequence[str]) -> NDArray[np.intp] | slice:
    if tuple(names) == joint_names:
        return slice(None)
    index_of = {name: index for index, name in enumerate(names)}
    if len(index_of) != len(names):
        check_names('joint_states.name', names)
    missing = [name for name in joint_names if name not in index_of]
    if missing:
        raise ValueError(
            f'joint_states.name lacks {len(missing)} of {len(joint_names)} rotors, '
            f'first {missing[0]!r}; publish every rotor of the chain in each message'
        )
    return np.array([index_of[name] for name in joint_names], dtype=np.intp)


def _by_rotor(
    rotors: Mapping[str, int],
    source: str,
    names: Sequence[str],
    values: Sequence[float],
    largest: float,
    remedy: str = 'send a smaller value or raise the limit parameter',
) -> Array:
    array = np.asarray(values, dtype=np.float64)
    check_names(source, names)
    for name in names:
        if name not in rotors:
            known = f'{next(iter(rotors))!r} to {list(rotors)[-1]!r}'
            raise ValueError(f'{source} names joint {name!r}, which is none of {known}')
    _check_array(source, names, array)
    for name, value in zip(names, array, strict=True):
        if abs(value) > largest:
            raise ValueError(
                f'{source} of {name} = {value:g} must lie in the range {-largest:g} to '
                f'{largest:g}; {remedy}'
            )
    by_rotor = np.zeros(len(rotors))
    by_rotor[[rotors[name] for name in names]] = array
    return by_rotor


def check_length(source: str, names: Sequence[str], values: Sequence[float] | Array) -> None:
    """Raise ValueError unless there are as many values as names.

    `source` is the name of the values in the error text.
    """
    if len(values) != len(names):
        raise ValueError(
            f'{source} has {len(values)} values for {len(names)} names; give one for each name'
        )


def _check_array(source: str, names: Sequence[str], values: Array) -> None:
    check_length(source, names, values)
    known = np.abs(values) <= LARGEST_ANGLE
    if known.all():
        return
    worst = int(np.argmin(known))
    value = f'{source} of {names[worst]} = {values[worst]:g}'
    if not math.isfinite(values[worst]):
        raise ValueError(f'{value} must be a finite number')
    if source.startswith('joint_states'):
        raise ValueError(
            f'{value} must lie in the range {-LARGEST_ANGLE:g} to {LARGEST_ANGLE:g}; check '
            'its publisher'
        )
