# SPDX-License-Identifier: Apache-2.0
"""Identification of a chain, with standard deviations, from a recording of a passing soliton."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from soliton_linkage.identification.adjustment import (
    Adjustment,
    adjust,
    observable_basis,
    passable,
)
from soliton_linkage.identification.bar_motion import BarMotion, bar_motion
from soliton_linkage.identification.diagnosis import (
    check_explained,
    obstacle_warnings,
    weakly_observable,
)
from soliton_linkage.identification.free_motion import FreeMotion, split_chain
from soliton_linkage.identification.lengths import initial_lengths, split_lengths
from soliton_linkage.identification.mass_scale import mass_scale
from soliton_linkage.identification.motion_fit import MotionFit, MotionFitter
from soliton_linkage.identification.mounting import check_unit
from soliton_linkage.identification.readings import (
    Readings,
    RecordedImpulse,
    informative_frames,
    join_recordings,
)
from soliton_linkage.identification.screening import (
    LEAST_NOISE,
    check_jumps,
    check_motion,
    check_slips,
    noise_of,
    stray_residuals,
    without_outliers,
)
from soliton_linkage.identification.windows import initial_windows
from soliton_linkage.linkage.chain import Array, Chain

_NOT_CLOSED = (
    'no lengths close the bonds of this recording; check the order, the signs and the zeros of '
    'the joints, and whether a rotor was held'
)
_MOST_KICKS = 3
"""Largest number of unrecorded kicks that are searched [1]; each requires another fit."""
_KICK_FRAMES = 7
"""Number of frames whose residuals are averaged to find a kick [1]."""
_BEFORE_KICK = 0.06
"""Unused time before an estimated kick [s]; 0.05 s after the kick are also unused."""
_SUSPICIOUS = 1.05
"""Threshold of residual noise over reading noise [1]: above it, a kick is searched."""
_KICKED = 5.5
"""Threshold of the mean residual of `_KICK_FRAMES` frames, in standard deviations [1]: a kick acts
there if the mean is larger. In 1 of 300 recordings (40 rotors, 2000 frames), noise exceeds it."""
_KICK = (
    'a kick that was not recorded acts near {}; the frames near it were not used for masses, '
    'springs and drag'
)
_ADJUSTMENTS = 6
"""Largest number of adjustments [1]; each may reveal outliers that were hidden by larger ones."""
_MOST_FITTED = 3000
"""Largest number of frames in the fit of a motion [1]; 40 rotors then take one or two minutes."""
_STRAINED = 1.1
"""Threshold of the ratio of misclosures to reading noise [1]: above it, bonds do not close."""
_WORSE = 1.25
"""Threshold of `bond_noise` over its median [1]: larger values are reported; 1.1 is usual."""


@dataclass(frozen=True)
class Identification:
    """An identified chain with its uncertainties."""

    chain: Chain
    """Identified chain; the given chain supplies the values that could not be estimated."""
    deviations: dict[str, Array]
    """Relative standard deviations of lengths, masses and stiffnesses [1]. The keys are the names
    of the fields of `Deviations`."""
    offsets: Array
    """Offset of each encoder, reading minus angle [rad], shape (N,)."""
    offset_deviations: Array
    """Standard deviations of the offsets [rad], shape (N,)."""
    noise: float
    """Standard deviation of a reading, estimated from the residuals of the model [rad]."""
    reading_noise: float
    """Standard deviation of a reading, estimated from its changes between frames [rad]."""
    bond_noise: Array
    """Standard deviation of a reading, estimated from each bond alone [rad], shape (N - 1,)."""
    tolerance: float
    """Relative standard deviation of lengths of one kind (e.g. of rotors) about their mean [1]."""
    rigid: bool
    """Whether all bonds close within the noise; they then seem rigid, with unknown stiffness."""
    unused_frames: int
    """Number of frames that were not used to estimate masses, stiffnesses and drag [1]."""
    weakly_observable: tuple[str, ...]
    """Weakly observable combinations of lengths."""
    warnings: tuple[str, ...]
    """Warnings for the user, one line each."""
    outliers: int = 0
    """Number of isolated wrong readings, which were not used [1]."""
    damping_deviation: float = math.nan
    """Standard deviation of the damping [N m s/rad], NaN if it was not estimated."""
    friction: float = math.nan
    """Dry friction of each rotor, in addition to the damping [N m], NaN if unknown."""
    friction_deviation: float = math.nan
    """Standard deviation of the dry friction [N m], NaN if friction was not estimated."""
    spacing_deviation: float = math.nan
    """Standard deviation of the logarithm of the mean spacing [1], NaN if not estimated."""
    mass_deviation: float = math.nan
    """Standard deviation of the logarithm of the mean mass [1], NaN if not estimated."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds in the order of decreasing noise."""
        return tuple(np.argsort(-self.bond_noise).tolist())


def identify(
    readings: Readings,
    given: Chain,
    tolerance: float | None = None,
    spacing_known: bool = True,
) -> Identification:
    """Identify a chain from a recording.

    Angles alone determine neither the mean spacing nor the mean mass, and sometimes not the
    damping. Gravity determines the mean spacing unless `spacing_known`. Known impulses determine
    the mean mass. The given chain supplies the values that the recording does not determine; its
    number of rotors and its other lengths are ignored. The tolerance of lengths [1] is estimated
    unless it is given. Raises ValueError, in one line, if the recording determines no chain.
    """
    for recording in readings.recordings:
        check_unit(recording.angles)
    used = join_recordings([without_outliers(each) for each in readings.recordings])
    _check_passage(used.recordings)
    noise = noise_of(used.unwrapped, used.relative_deviations)
    for recording in used.recordings:
        check_jumps(recording, noise)
    used, adjusted = _adjusted(used, noise, tolerance)
    known = spacing_known or not readings.gravity.acceleration
    found = _by_model(used, adjusted, given, noise, tolerance, known)
    outliers = np.isfinite(readings.angles).sum() - np.isfinite(used.angles).sum()
    return replace(found, outliers=int(outliers))


def _by_model(
    readings: Readings,
    found: Adjustment,
    given: Chain,
    noise: float,
    tolerance: float | None,
    spacing_known: bool,
) -> Identification:
    """Return the chain with springs or with rigid bars, whichever fits the readings best."""
    impulses = [impulse.time for impulse in readings.impulses]
    frames = informative_frames(readings.times, readings.unwrapped, impulses, _MOST_FITTED)
    unused = len(readings.times) - len(frames)
    some = replace(readings, angles=readings.unwrapped).select(frames)
    inputs = found.residuals[frames], found, given, noise, tolerance, spacing_known
    fitted, kicks = _fit_around_kicks(some, inputs, noise)
    if fitted is not None:
        check_slips(some, fitted.residuals, fitted.noise)
        prior, excess = fitted.prior, fitted.noise / max(noise, LEAST_NOISE)
        spreads = 0.0 if tolerance else prior.tolerances.lengths, prior.mass_deviation
        check_explained('springs', excess, spreads, fitted.residuals, some)
        given = _scaled(given, readings, fitted.motion.gravity)
        scale = mass_scale(fitted, some, given.spacing)
        result = _by_springs(fitted, given, noise, scale, unused)
        if kicks:
            named = ' and '.join(f'{time - some.times[0]:.3g} s' for time in sorted(kicks))
            result = replace(result, warnings=(_KICK.format(named), *result.warnings))
        return result
    residuals = found.residuals / readings.relative_deviations
    check_slips(readings, residuals, max(noise, found.noise))
    if not found.converged:
        raise ValueError(_NOT_CLOSED)
    spread = 0.0 if tolerance else found.tolerances.lengths
    excess = found.noise / max(noise, LEAST_NOISE)
    check_explained('bars', excess, (spread, 0.0), residuals, readings)
    strained = found.noise > _STRAINED * noise
    moved = None if strained else _fit_bars(some, found, given, spacing_known)
    if moved is None:
        return _by_bonds(found, given, noise, None, 0)
    return _by_bonds(found, _scaled(given, readings, moved.gravity), noise, moved, unused)


def _adjusted(
    readings: Readings, noise: float, tolerance: float | None
) -> tuple[Readings, Adjustment]:
    """Adjust the lengths; return the readings without outliers, and the adjustment."""
    start = initial_lengths(readings.filled)
    deviations = readings.relative_deviations
    for _ in range(_ADJUSTMENTS):
        try:
            found = adjust(readings.unwrapped, start, tolerance, deviations)
        except np.linalg.LinAlgError as error:
            raise ValueError(_NOT_CLOSED) from error
        limit = max(noise, found.noise)
        outliers = stray_residuals(found.residuals / deviations, limit)
        outliers &= np.isfinite(readings.angles)
        if not outliers.any():
            break
        readings = replace(readings, angles=np.where(outliers, np.nan, readings.angles))
        start = found.lengths
    return readings, found


def _check_passage(recordings: Sequence[Readings]) -> None:
    """Raise ValueError unless a wall passes all rotors in at least one recording."""
    errors = []
    for each in recordings:
        try:
            check_motion(each.filled, each.joints)
        except ValueError as error:
            errors.append(error)
        else:
            return
    raise errors[0]


def _scaled(given: Chain, readings: Readings, gravity: float) -> Chain:
    """Return the chain with mean spacing g / `gravity` [m], where `gravity` is in [1/s^2]."""
    acceleration = readings.gravity.acceleration
    return replace(given, spacing=acceleration / gravity) if acceleration else given


def _fit_around_kicks(
    some: Readings, inputs: tuple[Any, ...], noise: float
) -> tuple[MotionFit | None, list[float]]:
    """Fit springs to the motion between unrecorded kicks; return the fit and the kicks [s].

    A kick changes rates suddenly, so that no free motion fits the frames near it.
    """
    kicks: list[float] = []
    fitted = _fit_springs(some, *inputs)
    while fitted is not None and len(kicks) < _MOST_KICKS:
        frame, excess = _worst_frames(fitted)
        if excess < 1 and fitted.noise < _SUSPICIOUS * noise:
            break
        time = float(some.times[frame])
        around = [RecordedImpulse(time - _BEFORE_KICK), RecordedImpulse(time)]
        without = replace(some, impulses=[*some.impulses, *around])
        better = _fit_springs(without, *inputs)
        if better is None:
            break
        # By chance, an additional initial state reduces the squares by 2 N, with variance 4 N.
        gain = some.angles.size * (1 - (better.noise / fitted.noise) ** 2)
        states = 2 * some.angles.shape[1]
        if gain < states + _KICKED * math.sqrt(2 * states):
            break
        some, fitted = without, better
        kicks.append(time)
    return fitted, kicks


def _worst_frames(fitted: MotionFit) -> tuple[int, float]:
    """Return the frame with the largest mean residual of a rotor, and the ratio to its limit."""
    means = np.abs(uniform_filter1d(fitted.residuals, _KICK_FRAMES, axis=0))
    frame = int(np.argmax(means.max(axis=1)))
    return frame, float(means[frame].max() * math.sqrt(_KICK_FRAMES) / (_KICKED * fitted.noise))


def _fit_springs(
    some: Readings,
    residuals: Array,
    found: Adjustment,
    given: Chain,
    noise: float,
    tolerance: float | None,
    spacing_known: bool,
) -> MotionFit | None:
    """Fit the free motion of springs; return None if bars fit the readings equally well."""
    rotors = found.lengths.rotors
    angles = some.filled - found.lengths.offsets - residuals
    stiffness = given.stiffness / given.mass
    zeros, ones = np.zeros(rotors), np.ones(rotors)
    start = FreeMotion(
        found.lengths,
        stiffness * ones[1:],
        ones,
        0.0,
        zeros,
        zeros,
        gravity=some.gravity.acceleration / given.spacing,
    )
    windows = initial_windows(some.times, angles, start, some.interruptions, some.tilt_at)
    if not windows:
        return None
    inputs = some.times, some.unwrapped, some.relative_deviations, max(noise, LEAST_NOISE)
    try:
        return MotionFitter(windows, *inputs, tolerance, spacing_known).fit(found.noise)
    except np.linalg.LinAlgError:
        return None


def _fit_bars(
    some: Readings, found: Adjustment, given: Chain, spacing_known: bool
) -> BarMotion | None:
    """Fit the free motion of bars; return None if the bars do not move freely."""
    acceleration = some.gravity.acceleration / given.spacing
    some = replace(some, gravity=replace(some.gravity, acceleration=acceleration))
    noise = max(found.noise, LEAST_NOISE)
    try:
        return bar_motion(some, found.lengths, found.covariance, noise, spacing_known)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None


def _by_springs(
    fitted: MotionFit,
    given: Chain,
    reading_noise: float,
    scale: tuple[float, float] | None,
    unused_frames: int,
) -> Identification:
    """Return the result for springs: lengths, stiffnesses, masses and drag are estimated."""
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
    excess = fitted.noise / max(reading_noise, LEAST_NOISE)
    warnings = [*obstacle_warnings(chain, lengths, covariance)]
    if fitted.stamp_deviation:
        warnings.append(
            f'stamps have errors of {1e3 * fitted.stamp_deviation:.2g} ms, which the standard '
            'deviations include; stamp each frame at the time of its measurement'
        )
    if excess > _STRAINED:
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
    """Return a chain with a mean mass [kg] and the relative masses and forces of a motion."""
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


def _by_bonds(
    found: Adjustment,
    given: Chain,
    reading_noise: float,
    moved: BarMotion | None,
    unused_frames: int,
) -> Identification:
    """Return the result for bars: lengths from the bonds, masses and drag from the motion."""
    deviations = split_lengths(found.deviations)
    offsets = deviations.pop('offset')
    chain = found.lengths.scaled(given.spacing).chain(given)
    forces: dict[str, Any] = {}
    if moved is not None:
        unit = chain.mass * chain.spacing**2
        (damping, friction), (of_damping, of_friction) = moved.drag, moved.drag_deviations
        masses = tuple((moved.masses - 1).tolist())
        chain = replace(
            chain,
            damping=unit * max(damping, 0.0),
            deviations=replace(chain.deviations, mass=masses, damping=()),
        )
        forces = {
            'damping_deviation': unit * of_damping,
            'friction': unit * friction,
            'friction_deviation': unit * of_friction,
            'spacing_deviation': moved.gravity_deviation or math.nan,
        }
        deviations['mass'] = moved.mass_deviations
    rigid = found.noise <= _STRAINED * reading_noise
    warnings = [*obstacle_warnings(chain, found.lengths, found.covariance)]
    if not rigid:
        excess = found.noise / max(reading_noise, LEAST_NOISE)
        warnings.append(
            f'bonds do not close: their misclosures are {excess:.2g} times the noise of the '
            'readings, so that standard deviations are too small. A fast soliton strains springs, '
            'or pivots have play; record a slower soliton, and kick it before the first frame'
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
