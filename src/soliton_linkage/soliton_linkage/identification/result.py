# SPDX-License-Identifier: Apache-2.0
"""Result of an identification: the chain with its uncertainties and warnings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, observable_basis, passable
from soliton_linkage.identification.bar_motion import BarMotion
from soliton_linkage.identification.diagnosis import obstacle_warnings, weakly_observable
from soliton_linkage.identification.free_motion import FreeMotion, split_chain
from soliton_linkage.identification.lengths import split_lengths
from soliton_linkage.identification.motion_fit import NOISE_SCATTER, MotionFit
from soliton_linkage.linkage.chain import Array, Chain

STRAINED = 1.1
"""If the ratio of `noise` to `reading_noise` is larger than this [1], the model does not explain
the readings exactly, and the result contains a warning."""
_SIGNIFICANT = 4.0
"""Bars do not explain the readings if the squared residual noise of the fit of bars exceeds the
squared reading noise by more than this [standard deviations]."""
_UNEQUAL = 0.15
"""A fit of bars imitates an unrecorded force by unequal masses. Therefore the result contains a
warning if the standard deviation of the log masses exceeds this [1]. It was 0.03 to 0.07 in three
recordings of masses with deviations of 5 %, and 0.18 in one with an unrecorded pull."""
_WORSE = 1.25
"""The result contains a warning about a bond if its `bond_noise` is larger than this times the
median `bond_noise` of all bonds [1]. Ratios of 1.1 are usual."""


@dataclass(frozen=True)
class Identification:
    """Identified chain with its uncertainties."""

    chain: Chain
    """Identified chain; the given chain supplies the values that could not be estimated."""
    deviations: dict[str, Array]
    """Relative standard deviations of the parameters [1]; the keys are fields of `Deviations`."""
    offsets: Array
    """Offset of each encoder, reading minus angle [rad], (N,)."""
    offset_deviations: Array
    """Standard deviations of the offsets [rad], (N,)."""
    noise: float
    """Standard deviation of a reading [rad], computed from the residuals of the fit."""
    reading_noise: float
    """Standard deviation of a reading [rad], computed from second differences of readings."""
    bond_noise: Array
    """Standard deviation of a reading [rad], from the residuals at each bond, (N - 1,)."""
    tolerance: float
    """Prior relative standard deviation of lengths of one kind, for example of spacings [1]."""
    rigid: bool
    """Whether rigid bars explain the readings within the noise; stiffnesses are then unknown."""
    unused_frames: int
    """Number of frames that the fit of masses, stiffnesses and drag does not use."""
    weakly_observable: tuple[str, ...]
    warnings: tuple[str, ...]
    outliers: int = 0
    """Number of isolated wrong readings that the identification did not use."""
    damping_deviation: float = math.nan
    """Standard deviation of the damping [N m s/rad], NaN if unknown."""
    friction: float = math.nan
    """Dry friction of each rotor, in addition to the damping [N m], NaN if unknown."""
    friction_deviation: float = math.nan
    """Standard deviation of the dry friction [N m], NaN if unknown."""
    spacing_deviation: float = math.nan
    """Standard deviation of the log of the mean spacing [1]; NaN if unknown."""
    mass_deviation: float = math.nan
    """Standard deviation of the log of the mean mass [1], NaN if unknown."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds, sorted by decreasing `bond_noise`."""
        return tuple(np.argsort(-self.bond_noise).tolist())


def by_springs(
    fitted: MotionFit,
    given: Chain,
    reading_noise: float,
    scale: tuple[float, float] | None,
    unused_frames: int,
) -> Identification:
    """Return the result of a fit of springs.

    `scale` contains the mean mass [kg] and the standard deviation of its log [1], if known.
    """
    motion = fitted.motion
    deviations = split_chain(np.sqrt(np.diag(fitted.covariance)))
    geometry = motion.slices.lengths
    covariance = fitted.covariance[geometry, geometry]
    lengths = passable(motion.lengths, covariance)
    mass, mass_deviation = scale or (given.mass, math.nan)
    drag_unit = mass / float(motion.masses.mean()) * given.spacing**2
    chain = _with_motion(lengths.scaled(given.spacing).chain(given), motion, mass)
    offsets = deviations.pop('offset')
    damping, friction, gravity = (
        float(deviations.pop(name)[0]) for name in ('damping', 'friction', 'gravity')
    )
    rotor_noise = np.sqrt(np.mean(fitted.residuals**2, axis=0))
    excess = fitted.noise / reading_noise
    warnings = [*obstacle_warnings(chain, lengths, covariance)]
    if fitted.stamp_deviation:
        warnings.append(
            f'stamps have errors of {1e3 * fitted.stamp_deviation:.2g} ms, which the standard '
            'deviations include; stamp each frame at the time of its measurement'
        )
    if excess > STRAINED:
        warnings.insert(
            0,
            f'the residuals of the motion are {excess:.2g} times the noise of the readings, so '
            'that the standard deviations are too small; record a slower soliton, or select a '
            'part of the recording by --begin and --end',
        )
    return Identification(
        chain=chain,
        deviations=deviations,
        damping_deviation=drag_unit * damping,
        friction=drag_unit * motion.friction,
        friction_deviation=drag_unit * friction,
        spacing_deviation=gravity or math.nan,
        mass_deviation=mass_deviation,
        offsets=motion.lengths.offsets,
        offset_deviations=offsets,
        noise=fitted.noise,
        reading_noise=reading_noise,
        bond_noise=np.maximum(rotor_noise[:-1], rotor_noise[1:]),
        tolerance=fitted.prior.tolerances.lengths,
        rigid=False,
        unused_frames=unused_frames,
        weakly_observable=weakly_observable(fitted.information, fitted.basis, split_chain),
        warnings=tuple(warnings),
    )


def _with_motion(chain: Chain, motion: FreeMotion, mass: float) -> Chain:
    unit = mass / float(motion.masses.mean())
    deviations = replace(
        chain.deviations,
        mass=tuple((motion.masses / motion.masses.mean() - 1).tolist()),
        stiffness=tuple((motion.stiffnesses / motion.stiffnesses.mean() - 1).tolist()),
        damping=(),
    )
    return replace(
        chain,
        mass=mass,
        stiffness=unit * float(motion.stiffnesses.mean()),
        damping=unit * chain.spacing**2 * max(motion.damping, 0.0),
        deviations=deviations,
    )


def _with_forces(chain: Chain, moved: BarMotion) -> tuple[Chain, dict[str, Any]]:
    unit = chain.mass * chain.spacing**2
    (damping, friction), (of_damping, of_friction) = moved.drag, moved.drag_deviations
    masses = tuple((moved.masses - 1).tolist())
    chain = replace(
        chain,
        damping=unit * max(damping, 0.0),
        deviations=replace(chain.deviations, mass=masses, damping=()),
    )
    return chain, {
        'damping_deviation': unit * of_damping,
        'friction': unit * friction,
        'friction_deviation': unit * of_friction,
        'spacing_deviation': moved.gravity_deviation or math.nan,
    }


def bars_explain(found: Adjustment, reading_noise: float) -> bool:
    """Return whether the residual noise of bars is not significantly above the reading noise."""
    scatter = NOISE_SCATTER / math.sqrt(found.residuals.size)
    return found.noise**2 < reading_noise**2 * (1 + _SIGNIFICANT * scatter)


def by_bonds(
    found: Adjustment,
    given: Chain,
    reading_noise: float,
    moved: BarMotion | None,
    unused_frames: int,
) -> Identification:
    """Return the result of a fit of rigid bars.

    The lengths are those of `found`, and the masses and the drag those of `moved`. If `moved` is
    None, masses and drag are those of `given`.
    """
    deviations = split_lengths(found.deviations)
    offsets = deviations.pop('offset')
    chain = found.lengths.scaled(given.spacing).chain(given)
    forces: dict[str, Any] = {}
    if moved is not None:
        chain, forces = _with_forces(chain, moved)
        deviations['mass'] = moved.mass_deviations
    rigid = found.noise <= STRAINED * reading_noise
    warnings = [*obstacle_warnings(chain, found.lengths, found.covariance)]
    if not (rigid and bars_explain(found, reading_noise)):
        excess = found.noise / reading_noise
        warnings.append(
            f'bonds do not close: their misclosures are {excess:.3g} times the noise of the '
            'readings, so that standard deviations are too small. A fast soliton strains springs, '
            'pivots have play, or a force was not recorded, for example the force of a rotor that '
            'is missing before the first or after the last joint; record all rotors and a slower '
            'soliton, and kick it before the first frame'
        )
    spread = 0.0 if moved is None else float(np.std(np.log(moved.masses)))
    if spread > _UNEQUAL:
        warnings.append(
            f'the masses vary by {spread:.0%} from rotor to rotor. If the rotors are more equal, '
            'a force that was not recorded acted, for example a kick, and the masses are wrong; '
            'select free motion by --begin and --end'
        )
    usual = float(np.median(found.bond_noise))
    warnings += [
        f'the misclosure of bond {bond} is {found.bond_noise[bond] / usual:.2g} times the '
        'median; check that its encoders do not slip and its pivots have no play'
        for bond in np.flatnonzero(found.bond_noise > _WORSE * usual).tolist()
    ]
    basis = observable_basis(found.lengths)
    return Identification(
        chain=chain,
        deviations=deviations,
        **forces,
        offsets=found.lengths.offsets,
        offset_deviations=offsets,
        noise=found.noise,
        reading_noise=reading_noise,
        bond_noise=found.bond_noise,
        tolerance=found.tolerances.lengths,
        rigid=rigid,
        unused_frames=unused_frames,
        weakly_observable=weakly_observable(found.information, basis, split_lengths),
        warnings=tuple(warnings),
    )
