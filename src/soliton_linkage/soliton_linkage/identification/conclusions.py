# SPDX-License-Identifier: Apache-2.0
"""What is concluded from the motion of springs, or from bonds that close."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from soliton_linkage.identification.geometry.adjustment import Adjustment, measurable
from soliton_linkage.identification.geometry.lengths import Lengths, split_lengths
from soliton_linkage.identification.geometry.passable import nearly_stopping, passable
from soliton_linkage.identification.identification import Identification
from soliton_linkage.identification.motion.bar_motion import BarMotion
from soliton_linkage.identification.motion.free_motion import split_chain
from soliton_linkage.identification.motion.mass_scale import MassScale
from soliton_linkage.identification.motion.motion_fit import MotionFit
from soliton_linkage.identification.open_combinations import open_combinations
from soliton_linkage.identification.residuals import LEAST_NOISE
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import find_obstacles

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
        left_out=left_out,
        open_combinations=open_combinations(fitted.information, fitted.basis, split_chain),
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
        left_out=left_out,
        open_combinations=open_combinations(
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
