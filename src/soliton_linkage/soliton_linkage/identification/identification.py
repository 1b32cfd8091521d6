# SPDX-License-Identifier: Apache-2.0
"""Identification of a chain, with standard deviations, from a recording of a passing soliton."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, adjust
from soliton_linkage.identification.bar_motion import BarMotion, bar_motion
from soliton_linkage.identification.diagnosis import check_explained, length_warnings, unexplained
from soliton_linkage.identification.encoder_errors import (
    EncoderFault,
    bar_scores,
    encoder_fault,
    shown_by_bars,
)
from soliton_linkage.identification.free_motion import FreeMotion
from soliton_linkage.identification.kicks import fit_around_kicks
from soliton_linkage.identification.lengths import initial_lengths
from soliton_linkage.identification.mass_scale import mass_scale
from soliton_linkage.identification.motion_fit import MotionFit, MotionFitter
from soliton_linkage.identification.mounting import (
    NO_JOINT,
    NotNeighboursError,
    absent_joints,
    check_unit,
)
from soliton_linkage.identification.readings import (
    Readings,
    informative_frames,
    join_recordings,
)
from soliton_linkage.identification.result import (
    STRAINED,
    Identification,
    bars_explain,
    by_bonds,
    by_springs,
)
from soliton_linkage.identification.screening import (
    LEAST_NOISE,
    IncompletePassage,
    check_jumps,
    check_motion,
    check_slips,
    noise_of,
    stray_residuals,
    without_outliers,
)
from soliton_linkage.identification.stages import Stages
from soliton_linkage.identification.windows import ARRIVAL, FreeWindow, initial_windows
from soliton_linkage.linkage.chain import Array, Chain

_NOT_CLOSED = (
    'no lengths close the bonds of this recording; check the order, the signs and the zeros of '
    'the joints, and whether a rotor was held'
)
_ADJUSTED = 0.05
"""Progress that is reported after the fit of the lengths and offsets [1]."""
_KICK = (
    'a kick that was not recorded acts near {}; the frames near it were not used for masses, '
    'springs and drag. If nothing touched the chain, check that no rotor is missing before {} or '
    'after {}'
)
_STRAINING = (
    'torques act for {:.2g} s of this recording and may strain the springs; if the joints are '
    'correct, record again without torques'
)
_RIGID = (
    'bars are assumed only because {}; springs may fit better: record a longer passage without '
    'impulses'
)
_POSSIBLE = (
    'the following may be a fault, or only an effect of the noise; if it is a fault, the errors '
    'of the lengths are larger than stated: {}'
)
_ADJUSTMENTS = 6
"""Largest number of fits of the lengths [1]; outliers are removed after each fit."""
_CLEAR = 12.0
"""An encoder error that the fit of bars shows counts as clear if it is larger than this [standard
deviations]; strained springs cause apparent errors of up to 10. The fit of springs hides a part of
an encoder error, because masses and stiffnesses adapt to it. Therefore, a clear error is reported
if the fit of springs fails or does not explain the readings. If it explains them, only errors that
it shows itself are reported."""
_MOST_FITTED = 3000
"""Largest number of frames in the fit of a motion; for 40 rotors, this fit takes 20 s or more."""


class _Known(NamedTuple):
    chain: Chain
    noise: float
    """Standard deviation of a reading [rad]."""
    tolerance: float | None
    spacing_known: bool


def identify(
    readings: Readings,
    given: Chain,
    tolerance: float | None = None,
    spacing_known: bool = True,
    progress: Callable[[float], None] = lambda done: None,
) -> Identification:
    """Identify a chain from a recording; raise ValueError if the recording determines no chain.

    The mean spacing is estimated from the effect of gravity unless `spacing_known`. The mean mass
    is estimated if the recording contains impulses of known size. Values that the recording does
    not determine are copied from `given`.

    `tolerance` is the prior standard deviation of the log of a length [1]; if it is None, it is
    estimated. `progress` is called with the fraction of the work that is done [1].
    """
    absent = absent_joints(readings.joints)
    gaps = NO_JOINT in absent
    try:
        found = _identified(readings, given, tolerance, spacing_known, Stages(progress))
    except ValueError as error:
        lasting = 0.0 if isinstance(error, IncompletePassage) else _duration_of_torques(readings)
        strained = _STRAINING.format(lasting) if lasting else ''
        named = '' if gaps and isinstance(error, NotNeighboursError) else str(error)
        raise ValueError('; '.join(filter(None, (absent, named, strained)))) from error
    lengths = [] if gaps else length_warnings(found.chain)
    warnings = *filter(None, [absent]), *lengths, *found.warnings
    return replace(found, warnings=warnings)


def _duration_of_torques(readings: Readings) -> float:
    """Return the total time during which torques act [s].

    A torque is recorded as a series of impulses. Therefore two successive impulses belong to one
    torque if the time between them is shorter than `ARRIVAL`.
    """
    spans = np.diff(sorted(impulse.time for impulse in readings.impulses))
    return float(spans[spans < ARRIVAL].sum())


def _identified(
    readings: Readings, given: Chain, tolerance: float | None, spacing_known: bool, stages: Stages
) -> Identification:
    for recording in readings.recordings:
        check_unit(recording.angles)
    used = join_recordings([without_outliers(each) for each in readings.recordings])
    noise = max(noise_of(used.unwrapped, used.relative_deviations), LEAST_NOISE)
    for recording in used.recordings:
        check_jumps(recording, noise)
    _check_passage(used.recordings)
    used, adjusted = _adjusted(used, noise, tolerance)
    spacing_known = spacing_known or not readings.gravity.acceleration
    stages.enter(_ADJUSTED, _ADJUSTED)
    known = _Known(given, noise, tolerance, spacing_known)
    found = _by_model(used, adjusted, known, stages)
    outliers = np.isfinite(readings.angles).sum() - np.isfinite(used.angles).sum()
    stages.enter(1.0, 1.0)
    return replace(found, outliers=int(outliers))


def _by_model(
    readings: Readings, found: Adjustment, known: _Known, stages: Stages
) -> Identification:
    noise = known.noise
    impulses = [impulse.time for impulse in readings.impulses]
    frames = informative_frames(readings.times, readings.unwrapped, impulses, _MOST_FITTED)
    unused = len(readings.times) - len(frames)
    some = replace(readings, angles=readings.unwrapped).select(frames)
    residuals = found.residuals[frames]
    bar_noise = max(noise, found.noise)
    scores = bar_scores(readings, found, bar_noise)
    fault = encoder_fault(readings.joints, *scores)
    clear = fault if fault and fault.decrease > _CLEAR**2 else None

    def excess_of(fit: MotionFit) -> tuple[float, tuple[float, float]]:
        lengths = 0.0 if known.tolerance else fit.prior.tolerances.lengths
        return fit.noise / noise, (lengths, fit.prior.mass_deviation)

    def check_clear(fitted: tuple[MotionFitter, MotionFit] | str) -> None:
        explained = not isinstance(fitted, str) and not unexplained(*excess_of(fitted[1]))
        if clear and not explained:
            raise ValueError(clear.text)

    def fit_springs(
        part: Readings, windows: Sequence[FreeWindow]
    ) -> tuple[MotionFitter, MotionFit] | str:
        return _fit_springs(part, residuals, found, known, stages, windows)

    fitted, kicks = fit_around_kicks(some, fit_springs, noise, max(found.noise, LEAST_NOISE))
    check_clear(fitted)
    if isinstance(fitted, str):
        # A force strains springs, so that the readings of several encoders do not fit bars.
        likelier = not bars_explain(found, noise)
        fault = clear or (fault and fault.or_force(readings.joints, likelier))
        result = _by_bars(readings, some, found, known, fault)
        reason = (_RIGID.format(fitted),) if fitted else ()
        return _with_possible(replace(result, warnings=(*reason, *result.warnings)), fault)
    fitter, fit = fitted
    check_slips(some, fit.residuals, fit.noise)
    fault = encoder_fault(readings.joints, *fitter.error_scores())
    fault = fault and shown_by_bars(fault, readings.joints, *scores)
    check_explained('springs', *excess_of(fit), fit.residuals, some, fault)
    fit = fitter.sampled(fit)
    given = _scaled(known.chain, readings, fit.motion.gravity)
    scale = mass_scale(fit, some, given.spacing)
    result = by_springs(fit, given, noise, scale, unused)
    if kicks:
        ends = readings.joints[0], readings.joints[-1]
        named = ' and '.join(f'{time - some.times[0]:.3g} s' for time in sorted(kicks))
        result = replace(result, warnings=(_KICK.format(named, *ends), *result.warnings))
    return _with_possible(result, fault)


def _by_bars(
    readings: Readings,
    some: Readings,
    found: Adjustment,
    known: _Known,
    fault: EncoderFault | None,
) -> Identification:
    noise = known.noise
    residuals = found.residuals / readings.relative_deviations
    check_slips(readings, residuals, max(noise, found.noise))
    if not found.converged:
        raise ValueError(_NOT_CLOSED)
    spread = 0.0 if known.tolerance else found.tolerances.lengths
    check_explained('bars', found.noise / noise, (spread, 0.0), residuals, readings, fault)
    strained = found.noise > STRAINED * noise
    moved = None if strained else _fit_bars(some, found, known)
    if moved is None:
        return by_bonds(found, known.chain, noise, None, 0)
    given = _scaled(known.chain, readings, moved.gravity)
    return by_bonds(found, given, noise, moved, len(readings.times) - len(some.times))


def _with_possible(result: Identification, fault: EncoderFault | None) -> Identification:
    if fault is None:
        return result
    return replace(result, warnings=(_POSSIBLE.format(fault.text), *result.warnings))


def _adjusted(
    readings: Readings, noise: float, tolerance: float | None
) -> tuple[Readings, Adjustment]:
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
    acceleration = readings.gravity.acceleration
    return replace(given, spacing=acceleration / gravity) if acceleration else given


def _fit_springs(
    some: Readings,
    residuals: Array,
    found: Adjustment,
    known: _Known,
    stages: Stages,
    begun: Sequence[FreeWindow],
) -> tuple[MotionFitter, MotionFit] | str:
    """Return a fit of springs, or the reason if it fails, or '' if rigid bars fit equally well.

    The fit begins from the windows `begun`. If there are none, it begins from short windows of the
    fit `found` of bars, whose residuals [rad] in the frames of `some` are `residuals`.
    """
    rotors = found.lengths.rotors
    angles = some.filled - found.lengths.offsets - residuals
    stiffness = known.chain.stiffness / known.chain.mass
    zeros, ones = np.zeros(rotors), np.ones(rotors)
    start = FreeMotion(
        found.lengths,
        stiffness * ones[1:],
        ones,
        0.0,
        zeros,
        zeros,
        gravity=some.gravity.acceleration / known.chain.spacing,
    )
    windows = begun or initial_windows(some.times, angles, start, some.interruptions, some.tilt_at)
    if not windows:
        return 'no 30 successive frames of free motion lie between impulses and gaps'
    inputs = some.times, some.unwrapped, some.relative_deviations, known.noise
    try:
        fitter = MotionFitter(windows, *inputs, known.tolerance, known.spacing_known, stages)
        fitted = fitter.fit(found.noise, bool(begun))
    except np.linalg.LinAlgError:
        return 'the fit of springs did not converge'
    return (fitter, fitted) if fitted else ''


def _fit_bars(some: Readings, found: Adjustment, known: _Known) -> BarMotion | None:
    acceleration = some.gravity.acceleration / known.chain.spacing
    some = replace(some, gravity=replace(some.gravity, acceleration=acceleration))
    noise = max(found.noise, LEAST_NOISE)
    try:
        return bar_motion(some, found.lengths, found.covariance, noise, known.spacing_known)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
