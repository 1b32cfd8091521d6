# SPDX-License-Identifier: Apache-2.0
"""Experiments of the paper: the wall of a chain at rest is kicked along the zero mode.

The time unit is `Chain.time_unit`, sqrt(M / k_e). An edge rotor has two rest angles, because it
has only one spring. At the second one, its order field is not +1 or -1, even without a wall.
Therefore wall positions and static profiles exclude edge rotors.
"""

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

SNAPSHOTS = 10
"""Number of frames from which the profile of a wall is assembled [1], as in the paper."""
DISTANCE_LABEL = 'n - X [rotor spacings]'
"""Axis label of the distance of a rotor from a wall."""

_ARCTANH_REACH = 0.9
"""Largest order field |m| in a width fit [1], because arctanh(m) amplifies errors near |m| = 1."""
_MIDDLE = 0.3
"""Length of the middle part, where walls are measured, divided by the chain length [1]."""
_FRAMES = 600
"""Number of frames in a recording of a crossing."""
_SLACK = 1.1
"""A crossing is recorded for at least this multiple of `slow_crossing_time` [1]."""
_TRANSIENT = 1.5
"""A crossing is recorded for at least this multiple of the crossing time of sound [1]."""


def kick_rates(
    chain: Chain, angles: Array, kick: float, edge: Edge = Edge.LAST, anywhere: bool = False
) -> Array:
    """Return the angular velocities that drive the wall away from an edge [rad/s], shape (N,).

    The velocities are phi_dot = (a / r) sqrt(k_e / M) v0 e with the zero mode e of norm 1. The
    kick v0 is the norm r |phi_dot| divided by a sqrt(k_e / M). Raises ValueError if the wall is
    nearer to the other edge, unless `anywhere` is true.
    """
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    return speed * edge_mode(chain, angles, edge, anywhere)


def record_kick(chain: Chain, kick: float, duration: float, frames: int) -> Recording:
    """Kick a right-leaning chain at its last rotor; record it for `duration` [time units]."""
    rest = chain.uniform_state(1)
    rates = kick_rates(chain, rest, kick)
    whole = duration * chain.time_unit
    return simulate(chain, rest, rates, whole, whole / frames)


def record_moving_wall(chain: Chain, kick: float) -> tuple[Recording, float]:
    """Record the crossing of a kicked wall; return also the wall speed [rotor spacings/s]."""
    recording = record_kick(chain, kick, crossing_duration(chain, kick), _FRAMES)
    return recording, snapshots(chain, recording, 2).speed


def crossing_duration(chain: Chain, kick: float) -> float:
    """Return a recording time in which a kicked wall crosses the chain [time units]."""
    fastest = (chain.number_of_rotors - 1) * chain.spacing / speed_of_sound(chain)
    return max(_SLACK * slow_crossing_time(chain, kick), _TRANSIENT * fastest / chain.time_unit)


def slow_crossing_time(chain: Chain, kick: float) -> float:
    """Return the crossing time of a wall in a chain of rigid bars [time units].

    The time is (N - 1) (r / a) lambda / v0 for a kick v0, with the arc length lambda of the orbit
    per rotor spacing (`site_arc`).
    """
    way = site_arc(chain) * chain.rotor_length / chain.spacing
    return (chain.number_of_rotors - 1) * way / kick


def energy_per_rotor(chain: Chain, angles: Array, rates: Array) -> Array:
    """Return each rotor's kinetic energy plus half the energy of its springs [J], (..., N)."""
    of_springs = 0.5 * chain.stiffnesses * chain.spring_extensions(angles) ** 2
    kinetic = 0.5 * chain.moments_of_inertia * rates**2
    return np.asarray(kinetic + chain.gathered(of_springs / 2, of_springs / 2))


@dataclass(frozen=True)
class Snapshots:
    """K frames in which a wall moves through the middle of a chain of N rotors."""

    distances: Array
    """Signed distances n - X of the rotors from the wall [rotor spacings], shape (K, N)."""
    fields: Array
    """Order field m of the rotors [1], shape (K, N)."""
    angles: Array
    """Angles phi of the rotors [rad], shape (K, N)."""
    speed: float
    """Wall speed [rotor spacings / s], from a line fitted to the wall positions."""


def snapshots(chain: Chain, recording: Recording, count: int) -> Snapshots:
    """Return `count` frames of the first passage of the wall through the middle of the chain.

    The frames are evenly spaced in time. The wall position is the zero of the order field,
    interpolated linearly between two rotors (paper, Fig. 5). Raises ValueError if this passage has
    fewer than `count` frames.
    """
    fields, _ = order_field(chain, recording.angles)
    walls = wall_positions(chain, recording)
    passage = first_passage(chain, walls)
    frames = passage.stop - passage.start
    if frames < count:
        raise ValueError(
            f'the wall was in the middle of the chain in {frames} frames, but {count} are '
            'required; kick the wall, or record for longer or with more frames'
        )
    slope = np.polyfit(recording.times[passage], walls[passage], 1)[0]
    chosen = np.linspace(passage.start, passage.stop - 1, count).round().astype(int)
    distances = np.arange(chain.number_of_rotors) - walls[chosen, None]
    return Snapshots(distances, fields[chosen], recording.angles[chosen], abs(float(slope)))


def first_passage(chain: Chain, positions: Array) -> slice:
    """Return the range of frames in which a wall first passes the middle of the chain.

    The middle is the range from 35 to 65 % of the length of the chain. `positions` are the wall
    positions [rotor spacings], shape (T,).
    """
    middle = (chain.number_of_rotors - 1) / 2
    inside = np.abs(positions - middle) < _MIDDLE * middle
    entered = int(np.argmax(np.append(inside, True)))
    return slice(entered, entered + int(np.argmin(np.append(inside[entered:], False))))


def static_profile(chain: Chain, middle: float) -> tuple[Array, Array]:
    """Combine static walls at ten positions into one profile.

    The walls are at `middle`, `middle` + 0.1, and so on to `middle` + 0.9 [rotor spacings].
    Returns the distances of the rotors from the wall [rotor spacings] and their order field m [1],
    each of shape (K,). Edge rotors are excluded.
    """
    rotors, beyond = np.arange(chain.number_of_rotors), np.arange(SNAPSHOTS) / SNAPSHOTS
    fields = [order_field(chain, static_wall(chain, middle + each))[0] for each in beyond]
    positions = [(rotors - zero_crossing(field))[1:-1] for field in fields]
    return np.ravel(positions), np.ravel([field[1:-1] for field in fields])


def wall_positions(chain: Chain, recording: Recording) -> Array:
    """Return the wall position in each frame [rotor spacings], shape (T,); NaN without a wall."""
    fields, _ = order_field(chain, recording.angles)
    return np.array([zero_crossing(field) for field in fields])


def zero_crossing(field: Array) -> float:
    """Return the position of the first zero of an order field, shape (N,); NaN without a zero.

    Edge rotors are excluded.
    """
    negative = np.signbit(field[1:-1])
    crossings = np.flatnonzero(negative[1:] != negative[:-1])
    if not crossings.size:
        return float('nan')
    n = int(crossings[0]) + 1
    return n + float(field[n] / (field[n] - field[n + 1]))


def arctanh_width(positions: Array, fields: Array) -> float:
    """Estimate the width w of a wall m = -tanh(x / w) from the slope of arctanh(m) against x.

    The line is fitted to all points with |m| < 0.9 (paper, Fig. 5). Positions and width have the
    unit [rotor spacings].
    """
    near = np.abs(fields) < _ARCTANH_REACH
    slope = np.polyfit(positions[near], -np.arctanh(fields[near]), 1)[0]
    return float(1 / slope)
