# SPDX-License-Identifier: Apache-2.0
"""The experiments of the paper: a chain at rest, kicked along its zero mode, and its wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import order_field

MIDDLE = 0.3
"""Share of a chain about its middle in which a wall is measured: it is far from both edges [1]."""
SNAPSHOTS = 10
"""Frames of a wall that make its profile, as in the paper: ten places a rotor spacing."""
DISTANCE_LABEL = 'n - X [rotor spacings]'
"""Name of the places of rotors from a wall."""

_ARCTANH_REACH = 0.9
"""Largest order field whose arctanh is fitted: beyond it rounding and wake make it run away."""
_FRAMES = 600
"""In which a chain is recorded while its wall crosses."""
_SLACK = 1.1
"""Times that a wall takes from edge to edge by theory, in which it has surely crossed [1]."""
_TRANSIENT = 1.5
"""Times that sound takes from edge to edge, in which the fastest wall has surely crossed [1]."""


def kick_rates(
    chain: Chain, angles: Array, kick: float, edge: Edge = Edge.LAST, anywhere: bool = False
) -> Array:
    """Rates that send the wall away from an edge [rad/s], shape (N,).

    phi_dot = (a / r) sqrt(k_e / M) v0 e with e the unit zero mode: the kick v0 is the speed of
    the masses, r |phi_dot|, in units of a sqrt(k_e / M). Raises ValueError where the wall is
    nearer the other edge, unless it may be anywhere.
    """
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    return speed * edge_mode(chain, angles, edge, anywhere)


def record_kick(chain: Chain, kick: float, duration: float, frames: int) -> Recording:
    """Record the right-leaning chain of springs, kicked at its last rotor.

    The duration [time units sqrt(M / k_e)] is divided into as many periods as frames.
    """
    rest = chain.uniform_state(1)
    rates = kick_rates(chain, rest, kick)
    whole = duration * chain.time_unit
    return simulate(chain, rest, rates, whole, whole / frames)


def record_moving_wall(chain: Chain, kick: float) -> tuple[Recording, float]:
    """Record a kicked chain until its wall has crossed; also its speed [rotor spacings / s]."""
    recording = record_kick(chain, kick, crossing_duration(chain, kick), _FRAMES)
    return recording, snapshots(chain, recording, 2).speed


def crossing_duration(chain: Chain, kick: float) -> float:
    """Time in which a kicked wall has crossed its chain, and some more [time units]."""
    fastest = (chain.number_of_rotors - 1) * chain.spacing / speed_of_sound(chain)
    return max(_SLACK * slow_crossing_time(chain, kick), _TRANSIENT * fastest / chain.time_unit)


def slow_crossing_time(chain: Chain, kick: float) -> float:
    """Time from edge to edge of a wall for which no spring gives way [time units].

    (N - 1) Lambda / v0 with Lambda in units of the spacing, the way of a mass.
    """
    way = site_arc(chain) * chain.rotor_length / chain.spacing
    return (chain.number_of_rotors - 1) * way / kick


@dataclass(frozen=True)
class Snapshots:
    """A wall on its way through the middle of a chain, in K frames of N rotors."""

    distances: Array
    """Signed distances n - X of the rotors from the wall [rotor spacings], shape (K, N)."""
    fields: Array
    """Order field m of the rotors [1], shape (K, N)."""
    angles: Array
    """Actual angles [rad], shape (K, N)."""
    speed: float
    """Of the wall [rotor spacings / s], the slope of a line through its places."""


def snapshots(chain: Chain, recording: Recording, count: int, share: float = MIDDLE) -> Snapshots:
    """Frames with the wall in the middle share of the chain, on its first way through.

    The wall is where a line through the fields of two rotors passes through 0 (paper, Fig. 5).
    Raises ValueError where it never came there.
    """
    fields, _ = order_field(chain, recording.angles)
    walls = wall_positions(chain, recording)
    middle = (chain.number_of_rotors - 1) / 2
    inside = np.abs(walls - middle) < share * middle
    entered = int(np.argmax(inside))
    left = entered + int(np.argmin(np.append(inside[entered:], False)))
    if left - entered < count:
        raise ValueError(
            f'the wall was in the middle of the chain in {left - entered} frames, of which '
            f'{count} are wanted; kick it, record for longer, or record more frames'
        )
    slope = np.polyfit(recording.times[entered:left], walls[entered:left], 1)[0]
    chosen = np.linspace(entered, left - 1, count).round().astype(int)
    rotors = np.arange(chain.number_of_rotors)
    return Snapshots(
        distances=rotors - walls[chosen, None],
        fields=fields[chosen],
        angles=recording.angles[chosen],
        speed=abs(float(slope)),
    )


def static_profile(chain: Chain, middle: float) -> tuple[Array, Array]:
    """Rotors from the wall and order field of walls at rest at ten places a spacing, (K,) each.

    Without edge rotors, which rest at one of two angles.
    """
    places, fields = [], []
    for beyond in np.arange(SNAPSHOTS) / SNAPSHOTS:
        angles = static_wall(chain, middle + beyond)
        field, _ = order_field(chain, angles)
        rotors = np.arange(chain.number_of_rotors)
        places.append((rotors - zero_crossing(field))[1:-1])
        fields.append(field[1:-1])
    return np.ravel(places), np.ravel(fields)


def wall_positions(chain: Chain, recording: Recording) -> Array:
    """Place of the wall in each frame [rotor spacings] by `zero_crossing`, or NaN, shape (T,)."""
    fields, _ = order_field(chain, recording.angles)
    return np.array([zero_crossing(field) for field in fields])


def zero_crossing(field: Array) -> float:
    """Place where a field of shape (N,) first passes through 0 [rotor spacings], or NaN.

    Edge rotors are left out: when they have toggled they say nothing about the wall.
    """
    negative = np.signbit(field[1:-1])
    crossings = np.flatnonzero(negative[1:] != negative[:-1])
    if not crossings.size:
        return float('nan')
    n = int(crossings[0]) + 1
    return n + float(field[n] / (field[n] - field[n + 1]))


def arctanh_width(places: Array, fields: Array) -> float:
    """Width of a wall m = -tanh(x / w) [rotor spacings], from the slope of arctanh m by x.

    Least squares over all points with |m| < 0.9 (paper, Fig. 5).
    """
    near = np.abs(fields) < _ARCTANH_REACH
    slope = np.polyfit(places[near], -np.arctanh(fields[near]), 1)[0]
    return float(1 / slope)
