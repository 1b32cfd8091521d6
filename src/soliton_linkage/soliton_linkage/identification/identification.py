# SPDX-License-Identifier: Apache-2.0
"""A chain with standard deviations, by the motion of springs or by bonds that close."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.adjustment import (
    Adjustment,
    measurable,
    nearly_stopping,
    passable,
)
from soliton_linkage.identification.bar_motion import BarMotion
from soliton_linkage.identification.free_motion import split_chain
from soliton_linkage.identification.lengths import Lengths, split_lengths
from soliton_linkage.identification.mass_scale import MassScale
from soliton_linkage.identification.motion_fit import MotionFit
from soliton_linkage.identification.screening import LEAST_NOISE
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import find_obstacles


@dataclass(frozen=True)
class Identification:
    """A chain as the angles of a recording show it."""

    chain: Chain
    """With the mean spacing, mass, stiffness and damping that were given."""
    deviations: dict[str, Array]
    """Standard deviation of each length over that length [1], by the names of `Deviations`."""
    offsets: Array
    """What each encoder reads too much [rad], shape (N,)."""
    offset_deviations: Array
    """Standard deviations of these [rad], shape (N,)."""
    noise: float
    """Standard deviation of a reading [rad], as the bonds leave it open."""
    reading_noise: float
    """The same from frame to frame, which knows of no chain."""
    bond_noise: Array
    """The same as `noise` by each bond alone [rad], shape (N - 1,)."""
    tolerance: float
    """Standard deviation by which lengths of one kind differ from each other [1]."""
    damping_deviation: float
    """Standard deviation of the damping [N m s/rad], NaN where it is not told."""
    friction: float
    """Dry friction of each rotor, beside the damping [N m], NaN where it is not told."""
    friction_deviation: float
    """Standard deviation of it [N m]."""
    spacing_deviation: float
    """The same of the logarithm of the mean spacing [1], NaN where gravity did not tell that."""
    mass_deviation: float
    """The same of the logarithm of the mean mass [1], NaN where no push told that."""
    rigid: bool
    """Whether all bonds close to the noise, as bars do: then no stiffness is found."""
    unused_frames: int
    """Frames of the longest recordings by which masses, springs and drag were not found [1]."""
    weakly_observable: tuple[str, ...]
    """What the angles alone leave open, in words."""
    warnings: tuple[str, ...]
    """What a user must know of it, one line each."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds that leave most open, the worst first."""
        return tuple(np.argsort(-self.bond_noise).tolist())


_OF_SCALE = {'rotor_length', 'spacing', 'rest_length'}
_MOST_SAID = 4
"""Combinations that are named [1]."""
_LEAST_TOLD = 1e-4
"""Information below which a combination is not told at all [1]: to 100 times its size."""
_OPEN = 0.1
"""Standard deviation of a combination of lengths, by the angles alone, beyond which it is called
open [1]: more than workshops miss."""


def weakly_observable_combinations(
    information: Array, basis: Array, parts: Callable[[Array], dict[str, Array]]
) -> tuple[str, ...]:
    """What readings alone tell less well than workshops make it, the least first.

    For what readings say of all unknowns, (P, P), and an orthonormal basis of the changes that
    they may tell, whose parts have names.
    """
    values, vectors = np.linalg.eigh(basis.T @ information @ basis)
    loose = [
        _in_words(max(float(value), _LEAST_TOLD) ** -0.5, parts(basis @ vector))
        for value, vector in zip(values, vectors.T, strict=True)
        if value < _OPEN**-2
    ]
    more = (f'{len(loose) - _MOST_SAID} more',) if len(loose) > _MOST_SAID else ()
    return (*loose[:_MOST_SAID], *more)


def _in_words(spread: float, parts: dict[str, Array]) -> str:
    """Say which rotors and lengths a combination is of, and by how much it is open."""
    size = max(float(np.abs(part).max()) for part in parts.values())
    kinds = [name for name, part in parts.items() if np.abs(part).max() > 0.5 * size]
    sides = [
        np.concatenate([np.flatnonzero(sign * part > 0.5 * size) for part in parts.values()])
        for sign in (1, -1)
    ]
    large = min((side for side in sides if len(side)), key=np.ptp)
    what = 'scale' if set(kinds) == _OF_SCALE else ' and '.join(kinds)
    much = 'not at all' if spread >= _LEAST_TOLD**-0.5 else f'to {spread:.0%}'
    return f'{what} of rotors {large.min()} to {large.max()} against the others: {much}'


STRAINED = 1.1
"""Noise that is left over that from frame to frame, beyond which it is more than noise [1]."""
_WORSE = 1.25
"""Noise of a bond over that of most, beyond which it is called bad [1]: of 1000 frames chance
makes 1.1."""
_NO_FORCES = dict.fromkeys(
    ('damping_deviation', 'friction', 'friction_deviation', 'spacing_deviation'), math.nan
)
"""What is told of a chain that does not move freely."""


def of_springs(
    fitted: MotionFit,
    given: Chain,
    reading_noise: float,
    scale: MassScale | None,
    left_out: int = 0,
) -> Identification:
    """Chain of springs, whose stiffnesses, masses and damping the motion shows too.

    By all frames but those that were left out.
    """
    motion = fitted.motion
    parts = split_chain(np.sqrt(np.diag(fitted.covariance)))
    geometry = motion.parts.lengths
    lengths = passable(motion.lengths, fitted.covariance[geometry, geometry])
    chain = lengths.scaled(given.spacing).chain(given)
    mass = given.mass if scale is None else scale.mass
    of_mean = mass / float(motion.masses.mean())
    of_drag = of_mean * given.spacing**2
    chain = replace(
        chain,
        mass=mass,
        stiffness=of_mean * float(motion.stiffnesses.mean()),
        damping=of_drag * max(motion.damping, 0.0),
        deviations=replace(
            chain.deviations,
            mass=tuple((motion.masses / motion.masses.mean() - 1).tolist()),
            stiffness=tuple((motion.stiffnesses / motion.stiffnesses.mean() - 1).tolist()),
            damping=(),
        ),
    )
    offsets = parts.pop('offset')
    damping, friction, gravity = (
        float(parts.pop(name)[0]) for name in ('damping', 'friction', 'gravity')
    )
    by_bond = np.sqrt(np.mean(fitted.left**2, axis=0))
    return Identification(
        chain=chain,
        deviations=parts,
        damping_deviation=of_drag * damping,
        friction=of_drag * motion.friction,
        friction_deviation=of_drag * friction,
        spacing_deviation=gravity or math.nan,
        mass_deviation=math.nan if scale is None else scale.deviation,
        offsets=motion.lengths.offsets,
        offset_deviations=offsets,
        noise=fitted.noise,
        reading_noise=reading_noise,
        bond_noise=np.maximum(by_bond[:-1], by_bond[1:]),
        tolerance=fitted.prior.tolerances.of_lengths,
        rigid=False,
        unused_frames=left_out,
        weakly_observable=weakly_observable_combinations(
            fitted.information, fitted.basis, split_chain
        ),
        warnings=(
            *_unexplained(fitted.noise, reading_noise),
            *_obstacles(chain),
            *_near_obstacles(lengths, fitted.covariance[geometry, geometry]),
        ),
    )


def of_bonds(
    found: Adjustment,
    given: Chain,
    reading_noise: float,
    moved: BarMotion | None = None,
    left_out: int = 0,
) -> Identification:
    """Chain whose bonds close, as bars do, or springs about slow walls.

    With what the free motion of bars shows, where they move freely, by all frames but those that
    were left out.
    """
    deviations = split_lengths(found.deviations)
    offsets = deviations.pop('offset')
    rigid = found.noise <= STRAINED * reading_noise
    chain, forces = found.lengths.scaled(given.spacing).chain(given), _NO_FORCES
    if moved is not None:
        chain, forces = _of_bars(chain, moved)
        deviations['mass'] = moved.mass_deviations
    return Identification(
        chain=chain,
        deviations=deviations,
        **forces,
        mass_deviation=math.nan,
        offsets=found.lengths.offsets,
        offset_deviations=offsets,
        noise=found.noise,
        reading_noise=reading_noise,
        bond_noise=found.bond_noise,
        tolerance=found.tolerances.of_lengths,
        rigid=rigid,
        unused_frames=left_out,
        weakly_observable=weakly_observable_combinations(
            found.information, measurable(found.lengths), split_lengths
        ),
        warnings=(
            *_obstacles(chain),
            *_near_obstacles(found.lengths, found.covariance),
            *(() if rigid else _open_bonds(found, reading_noise)),
            *_bad_bonds(found.bond_noise),
        ),
    )


def _of_bars(chain: Chain, moved: BarMotion) -> tuple[Chain, dict[str, float]]:
    """Chain with the masses and the drag that the motion of bars shows, and how sure these are."""
    of_drag = chain.mass * chain.spacing**2
    (damping, friction), (of_damping, of_friction) = moved.drag, moved.drag_deviations
    masses = tuple((moved.masses - 1).tolist())
    found = replace(
        chain,
        damping=of_drag * max(damping, 0.0),
        deviations=replace(chain.deviations, mass=masses, damping=()),
    )
    return found, {
        'damping_deviation': of_drag * of_damping,
        'friction': of_drag * friction,
        'friction_deviation': of_drag * of_friction,
        'spacing_deviation': moved.gravity_deviation or math.nan,
    }


def _open_bonds(found: Adjustment, reading_noise: float) -> tuple[str, ...]:
    more = found.noise / max(reading_noise, LEAST_NOISE)
    return (
        f'bonds leave {more:.2g} times the noise of the readings: '
        'springs give way about a fast soliton, or pivots have play, and standard deviations '
        'are too small; record a slower soliton, with its kick before the first frame',
    )


def _bad_bonds(bond_noise: Array) -> tuple[str, ...]:
    usual = float(np.median(bond_noise))
    return tuple(
        f'bond {bond} leaves {bond_noise[bond] / usual:.2g} times the noise of most bonds: '
        'an encoder may slip there, or a pivot have play'
        for bond in np.flatnonzero(bond_noise > _WORSE * usual).tolist()
    )


def _unexplained(noise: float, reading_noise: float) -> tuple[str, ...]:
    least = max(reading_noise, LEAST_NOISE)
    if noise <= STRAINED * least:
        return ()
    return (
        f'the motion of springs leaves {noise / least:.2g} times the noise of the '
        'readings, and standard deviations are too small; record with a slower soliton, or less '
        'of it by --begin and --end',
    )


def _obstacles(chain: Chain) -> tuple[str, ...]:
    return tuple(
        f'bond {each.bond} may stop a wall: {each.rest_length:.4g} m {each.reason}'
        for each in find_obstacles(chain)
    )


def _near_obstacles(lengths: Lengths, covariance: Array) -> tuple[str, ...]:
    near = nearly_stopping(lengths, covariance)
    if not near:
        return ()
    bonds = ', '.join(f'{bond} ({chance:.1%})' for bond, chance in near.items())
    return (
        f'bonds that nearly stop walls, and how likely they are to be beyond that limit: {bonds}; '
        'record more crossings to know their lengths better, or mend them',
    )
