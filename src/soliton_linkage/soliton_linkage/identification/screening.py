# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording before identification, and of the residuals after identification.

In a flipper, the staggered angles of a rotor (phi_n for even n, pi - phi_n for odd n) before and
after the passage of a wall are symmetric about a centre. If all encoders have a correct zero, the
centres of all rotors are 0, or all are pi.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, median_filter

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.encoder_errors import unrecorded_force
from soliton_linkage.identification.mounting import (
    check_mounting,
    check_neighbours,
    zeros_explain,
)
from soliton_linkage.identification.readings import (
    Readings,
    dense_interval,
    repeat_counts,
    rounding_noise,
)
from soliton_linkage.linkage.chain import Array, staggered, wrapped

_LEANING = 0.5
"""A rotor clearly leans in a frame if |sin(phi)| is larger than this times the median of
|sin(phi)| of this rotor over all frames [1]."""
_FAR_OFF = 2.0
"""If the largest zero error is larger than this, the joints probably have a wrong order [rad]."""
_LARGEST_ZERO_ERROR = 0.5
"""Largest zero error for which the fit of lengths and offsets converges [rad]. For correct
encoders, `_zero_errors` returns errors of up to 0.3 rad."""
_SMALLEST_GAIN_ERROR = 0.05
"""Smallest relative gain error, common to all encoders, that is reported before the fit [1]; the
fit finds smaller errors."""
_SIGNIFICANT_GAIN = 4.0
"""A common gain error is reported if it is larger than this [standard deviations]. In 27 correct
recordings of 12 and 20 rotors, the largest apparent error was 1.9."""
_ZERO_SCATTER = 0.1
"""Lower limit of the standard deviation of the results of `_zero_errors` [rad], typical of correct
encoders. A short chain has too few results to estimate a smaller standard deviation."""
_LEAST_SPREAD = 1.0
"""A common gain error is estimated only if the standard deviation of the mean readings of the
rotors is at least this [rad]."""
_OTHER_FAULT = 1.0
"""If the correction of a common gain error leaves a zero error larger than this [rad], there is
another fault, for example an error of half a turn."""
_FEWEST_GAINS = 4
"""Smallest number of rotors from which a common gain error is estimated [1]."""
_LARGEST_GAIN_ERROR = 0.25
"""Largest relative error of the gain of one encoder that is reported as a possible cause of an
apparent error of its zero [1]."""
_TRIMMINGS = 6
"""Number of iterations that compute the robust mean of the angles at rest [1]."""
_SHARPNESS = 20.0
"""Sharpness s of the robust mean [1/rad^2]: the weight at the distance d is exp(-s d^2 / 2)."""


class IncompletePassage(ValueError):
    """Error for a recording in which no wall passes all rotors."""


def check_motion(readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError unless a wall passes all rotors in order in `readings` [rad], (T, N)."""
    check_common_gain(readings)
    check_mounting(readings, names)
    check_zeros(readings, names)
    inner = leaning_over(readings)[1:-1]
    if not inner.any():
        raise IncompletePassage(
            'no soliton passes in this recording, because no rotor changes its side; nudge the '
            'chain during the recording'
        )
    if not inner.all():
        still = 1 + np.flatnonzero(~inner)
        between = np.convolve(inner, [1, 0, 1], 'same')[still - 1] == 2
        if between.any():
            raise ValueError(
                f'{names[int(still[np.argmax(between)])]} does not change its side although the '
                'soliton passes both neighbours: the rotor is held, or the zero error of its '
                'encoder exceeds its lean; release the rotor and set the zero'
            )
        raise IncompletePassage(
            f'the soliton passes only {len(inner) - still.size} of {len(inner)} inner rotors, '
            f'not {names[int(still[0])]}; record until it has reached both edges'
        )
    check_neighbours(readings, names)


def check_common_gain(readings: Array) -> None:
    """Raise ValueError if `readings` [rad], (T, N), show the same wrong gain of all encoders.

    A relative gain error e causes an apparent zero error of each rotor, which is e times the mean
    reading of the rotor. Without errors, mean readings are multiples of half a turn.
    """
    signs = (-1.0) ** np.arange(readings.shape[1])
    errors = _zero_errors(readings)
    known = errors != 0
    if known.sum() < _FEWEST_GAINS:
        return
    middles = (signs * (readings.max(axis=0) + readings.min(axis=0)) / 2)[known]
    middles -= middles.mean()
    errors = errors[known] - errors[known].mean()
    squares = float(middles @ middles)
    if squares < len(middles) * _LEAST_SPREAD**2:
        return
    size = float(middles @ errors) / squares
    rest = errors - size * middles
    variance = max(float(rest @ rest) / (len(rest) - 2), _ZERO_SCATTER**2)
    spread = math.sqrt(variance / squares)
    significant = abs(size) > max(_SMALLEST_GAIN_ERROR, _SIGNIFICANT_GAIN * spread)
    if significant and np.abs(rest).max() < _OTHER_FAULT:
        raise ValueError(
            f'each rotor has a wrong gain, its readings are about {abs(size):.0%} too '
            f'{"large" if size > 0 else "small"}: correct the counts per turn'
        )


def check_zeros(readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError if the encoder of an inner rotor has a large zero error."""
    errors = _zero_errors(readings) * (-1.0) ** np.arange(readings.shape[1])
    errors[np.abs(errors) < _LARGEST_ZERO_ERROR] = 0.0
    errors[[0, -1]] = 0.0
    wrong = np.flatnonzero(errors)
    if wrong.size and np.abs(errors).max() < _FAR_OFF and zeros_explain(readings, errors):
        n = int(wrong[0])
        middle = float(readings[:, n].max() + readings[:, n].min()) / 2
        gain = errors[n] / middle if middle else 0.0
        or_gain = (
            f'; if the zero is correct, its readings are {abs(gain):.0%} too '
            f'{"large" if gain > 0 else "small"}: correct the counts per turn'
            if 0 < abs(gain) < _LARGEST_GAIN_ERROR
            else ''
        )
        more = f', and of {wrong.size - 1} more rotors,' if wrong.size > 1 else ''
        raise ValueError(
            f'the zero of {names[n]}{more} has an error of about {errors[n]:.2g} rad, '
            f'more than {_LARGEST_ZERO_ERROR:g} rad; set it to the upright position{or_gain}'
        )


def _zero_errors(readings: Array) -> Array:
    """Return approximate zero errors of the staggered angles [rad], (N,).

    For odd rotors, they have the opposite sign of the zero errors of the encoders. In a flipper, a
    zero error is the mean of the staggered angles before and after the passage of a wall (minus pi
    if the chain is upside down). In a spinner, each passage turns the rotors by half a turn, so
    that this mean is undefined. Therefore, the direction of a rotor before the passage is compared
    with the mean direction of all rotors before the passage, and the same is done after the
    passage. The zero error is the mean of the two differences.
    """
    sine = np.sin(readings)
    clear = np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0)
    turns = np.exp(1j * staggered(readings))
    right, left = (_direction_at_rest(turns, clear & side) for side in (sine > 0, sine < 0))
    if np.median(np.real(right) * np.real(left)) > 0:
        up = np.sign(np.sum(np.real(right + left))) or 1.0
        error = (right + left) * up
    else:
        error = right * np.conj(np.sum(right)) + left * np.conj(np.sum(left))
    both = (np.abs(right) > 0) & (np.abs(left) > 0)
    return np.where(both, np.angle(error), 0.0)


def _direction_at_rest(
    turns: NDArray[np.complex128], some: NDArray[np.bool_]
) -> NDArray[np.complex128]:
    weights = some.astype(np.float64)
    for _ in range(_TRIMMINGS):
        means = np.sum(turns * weights, axis=0)
        middle = means / np.maximum(np.abs(means), 1e-9)
        weights = some * np.exp(_SHARPNESS * (np.real(turns * np.conj(middle)) - 1))
    return np.asarray(middle)


def leaning_over(readings: Array) -> NDArray[np.bool_]:
    """Return which rotors clearly lean to both sides at different times, (N,)."""
    sine = np.sin(readings)
    clear = np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0)
    return np.asarray((clear & (sine > 0)).any(axis=0) & (clear & (sine < 0)).any(axis=0))


LEAST_NOISE = 1e-4
"""The fits, and the searches for outliers, assume at least this noise of a reading [rad]."""
_OUTLIER = 7.0
"""A reading counts as wrong if it differs from a smooth motion by more than this [standard
deviations] plus the term with `_OF_RANGE`."""
_OF_RANGE = 0.3
"""While a rotor turns, correct readings also differ from a smooth motion. Therefore a run of
readings may differ by an additional term: this times the number of readings in the run times the
range of the adjacent readings [1]."""
_BESIDE = 3
"""A run of readings is compared with this many readings before it and after it [1]."""
_LONGEST_RUN = 3
"""A run of successive wrong readings of a rotor is removed if it is not longer than this [1]; a
longer run may be a slip of the encoder."""
_SPARSE = 3.0
"""Readings beside a frame interval longer than this times `dense_interval` are not searched for
errors [1], because a rotor may turn far in such an interval. Sensitivity: if 20 % of the frames
are lost, 89 % of the wrong readings are found. With half this value, 17 % are found, and with
twice this value, all. With each of the three values, 54 correct recordings, whose intervals reach
8 times the dense one, pass all checks."""
_PASSES = 6
"""Largest number of searches for wrong readings [1]; a large error hides smaller ones near it."""


def without_outliers(recording: Readings) -> Readings:
    """Return a recording in which isolated wrong readings are replaced by NaN."""
    noise = noise_of(recording.unwrapped, recording.relative_deviations)
    noise = max(noise, LEAST_NOISE)
    dense = ~_sparse(recording.times, _BESIDE)[:, None]
    for _ in range(_PASSES):
        limits = _OUTLIER * noise * recording.relative_deviations
        outliers = isolated(recording.filled, limits) & dense & np.isfinite(recording.angles)
        if not outliers.any():
            break
        recording = replace(recording, angles=np.where(outliers, np.nan, recording.angles))
    return recording


def _sparse(times: Array, reach: int) -> NDArray[np.bool_]:
    spans = np.diff(times)
    long = spans > _SPARSE * dense_interval(times)
    beside = np.append(long, False) | np.append(False, long)
    return np.asarray(binary_dilation(beside, np.ones(2 * reach + 1)))


def isolated(angles: Array, limits: Array) -> NDArray[np.bool_]:
    """Return which angles, (T, N), are outliers: runs of up to 3 angles that fit no smooth motion.

    Each angle of such a run differs from three predictions by more than the allowed difference.
    Differences are computed modulo 2 pi. The first prediction is a cubic curve through the two
    angles before and the two angles after the run. The second one consists of two lines through
    the last angle before the run: one through the last but one, and one through the last but two.
    The larger of the two differences counts, so that an angle fits this prediction only if it fits
    both lines. The third prediction consists of the corresponding lines after the run. Near a
    permanent step, correct angles differ from the cubic curve, but not from the lines on their own
    side of the step.

    The allowed difference is `limits` [rad], (T, N), plus the term with `_OF_RANGE`.
    """
    runs = [_run_excess(angles, limits, length) for length in range(1, _LONGEST_RUN + 1)]
    excess = np.zeros_like(angles)
    for length, found in enumerate(runs, 1):
        for start in range(length):
            part = excess[start : start + len(found)]
            np.maximum(part, found, out=part)
    outliers = np.zeros(angles.shape, dtype=np.bool_)
    padded = np.pad(excess, ((2, 2), (0, 0)))
    for length, found in enumerate(runs, 1):
        around = sliding_window_view(padded, length + 4, axis=0).max(axis=-1)
        largest = (found > 1) & (found == around)
        for start in range(length):
            outliers[start : start + len(found)] |= largest
    return outliers


def _run_excess(angles: Array, limits: Array, length: int) -> Array:
    """Return the smallest ratio of difference to limit in each run of `length` angles."""
    count = len(angles) - length + 1
    padded = np.pad(angles, ((_BESIDE, _BESIDE), (0, 0)), 'reflect')
    places = [*range(_BESIDE), *range(_BESIDE + length, 2 * _BESIDE + length)]
    beside = np.stack([padded[place : place + count] for place in places])
    last = beside[_BESIDE - 1]
    beside = last + wrapped(beside - last)
    ordered = np.sort(beside, axis=0)
    # One of the adjacent readings may be wrong.
    ranges = np.minimum(ordered[-1] - ordered[1], ordered[-2] - ordered[0])
    curves = np.tensordot(_curve_weights(length), beside, 1)
    inside = sliding_window_view(angles, length, axis=0).transpose(2, 0, 1)
    allowed = sliding_window_view(limits, length, axis=0).transpose(2, 0, 1)
    cubic, *lines = np.abs(wrapped(inside - curves))
    differences = np.minimum(cubic, np.minimum(np.maximum(*lines[:2]), np.maximum(*lines[2:])))
    return np.asarray((differences / (allowed + _OF_RANGE * length * ranges)).min(axis=0))


def _curve_weights(length: int) -> Array:
    """Return the weights of six adjacent angles in five predictions of a run.

    The predictions are the cubic curve, the two lines before and the two lines after the run that
    `isolated` describes. The shape is (5, `length`, 6).
    """
    places = np.array([-3, -2, -1, length, length + 1, length + 2])
    nodes = [1, 2, 3, 4], [1, 2], [0, 2], [3, 4], [3, 5]
    weights = np.zeros((len(nodes), length, len(places)))
    for curve, some in zip(weights, nodes, strict=True):
        points = np.vander(places[some])
        curve[:, some] = np.vander(np.arange(length), len(some)) @ np.linalg.inv(points)
    return weights


_STRAY = 6.0
"""A residual is an outlier if its distance from the median of adjacent residuals is larger than
this times the noise [1]."""
_MEDIAN_FRAMES = 9
"""Number of adjacent residuals whose median is computed; up to four outliers change it little."""


def stray_residuals(residuals: Array, noise: float) -> NDArray[np.bool_]:
    """Return which residuals [rad] are outliers, (T, N): at most one in each frame."""
    usual = median_filter(residuals, (_MEDIAN_FRAMES, 1), mode='nearest')
    distances = np.abs(residuals - usual)
    largest = distances == distances.max(axis=1, keepdims=True)
    return np.asarray(largest & (distances > _STRAY * noise))


_SLIP_RANGE = 3.0
"""An encoder slips if the cumulative sum of its n residuals, after subtraction of their mean,
exceeds this times the noise times sqrt(n) in a frame [1]."""
_SMALLEST_SLIP = 2.0
"""Smallest slip that is reported, relative to the noise of a reading [1]."""
_JUMP_FRAMES = 15
"""Number of frames before a jump, and also after it, whose mean angles are compared."""
_JUMP_OVER_NOISE = 10.0
"""Smallest jump that is reported, relative to the noise [1]; noise caused jumps of up to 7."""
_SMALLEST_JUMP = 0.1
"""Smallest jump that is reported [rad]; the motion of a rotor causes no such jump."""
_JUMP_OVER_NEIGHBOURS = 3.0
"""A jump is reported if it is larger than this times each neighbour's simultaneous jump [1]."""


def noise_of(readings: Array, relative_deviations: Array) -> float:
    """Return the noise of a reading [rad] from the sizes of second differences; NaN if unknown."""
    bends = readings[2:] - 2 * readings[1:-1] + readings[:-2]
    squares = relative_deviations**2
    bends /= np.sqrt(squares[2:] + 4 * squares[1:-1] + squares[:-2])
    sizes = np.abs(bends[np.isfinite(bends)])
    if not len(sizes):
        return math.nan
    rounding = rounding_noise(readings) / float(np.nanmedian(relative_deviations))
    return max(robust_deviation(sizes), rounding)


def noise_by_rotor(readings: Array) -> Array:
    """Return the noise of the readings, (T, N), of each rotor [rad], (N,); NaN if unknown."""
    return np.array([noise_of(each, np.ones_like(each)) for each in readings.T[..., None]])


def check_jumps(recording: Readings, noise: float) -> None:
    """Raise ValueError if readings of an inner rotor jump while its neighbours do not."""
    times, readings, deviations = recording.times, recording.filled, recording.relative_deviations
    width = min(_JUMP_FRAMES, len(readings) // 4)
    sudden = _sudden_changes(readings, 1)
    # A single wrong reading beside a jump does not affect the change over three intervals.
    sudden[3:-3] = np.minimum(sudden[3:-3], _sudden_changes(readings, 3))
    sudden[_sparse(times, 2)[1:-2]] = 0.0
    sudden /= np.max([deviations[frame : frame + len(sudden)] for frame in range(4)], axis=0)
    sums = np.cumsum(np.vstack([np.zeros(readings.shape[1]), readings]), axis=0)
    means = (sums[width:] - sums[:-width]) / width
    steps = np.minimum(np.abs(means[width:] - means[:-width]), sudden[width - 2 : 2 - width])
    beside = np.maximum(steps[:, :-2], steps[:, 2:])
    smallest = max(_JUMP_OVER_NOISE * noise, _SMALLEST_JUMP)
    limit = np.maximum(smallest, _JUMP_OVER_NEIGHBOURS * beside)
    excess = steps[:, 1:-1] / limit
    frame, rotor = divmod(int(np.argmax(excess)), excess.shape[1])
    if excess[frame, rotor] > 1:
        raise _slip_error(
            recording.joints[rotor + 1], steps[frame, rotor + 1], times[frame + width] - times[0]
        )


def _sudden_changes(readings: Array, frames: int) -> Array:
    """Return how far each change of a reading differs from the mean of two other changes [rad].

    A change is the difference of a reading from the reading `frames` frames earlier. The two
    other changes are those `frames` frames earlier and later.
    """
    changes = readings[frames:] - readings[:-frames]
    usual = (changes[: -2 * frames] + changes[2 * frames :]) / 2
    return np.asarray(np.abs(changes[frames:-frames] - usual))


def check_slips(recording: Readings, residuals: Array, noise: float) -> None:
    """Raise ValueError if the residuals of an encoder have a step.

    `residuals` [rad] have been divided by the relative deviations of the readings.
    """
    single = residuals / np.sqrt(repeat_counts(recording.unwrapped))
    sums = np.cumsum(single - single.mean(axis=0), axis=0) / (noise * math.sqrt(len(residuals)))
    largest = np.abs(sums).max(axis=0)
    rotor = int(np.argmax(largest))
    frame = int(np.argmax(np.abs(sums[:, rotor]))) + 1
    step = float(residuals[frame:, rotor].mean() - residuals[:frame, rotor].mean())
    if largest[rotor] > _SLIP_RANGE and abs(step) > _SMALLEST_SLIP * noise:
        time = recording.times[frame] - recording.times[0]
        error = _slip_error(recording.joints[rotor], step, time)
        if 0 < rotor < len(largest) - 1:
            raise error
        # A force on an edge rotor, which has one neighbour, causes similar residuals.
        raise ValueError(f'{error}; or {unrecorded_force(recording.joints)}')


def _slip_error(name: str, step: float, time: float) -> ValueError:
    return ValueError(
        f'the encoder of {name} slips by about {abs(step):.2g} rad at {time:.3g} s; fasten it and '
        'record again'
    )
