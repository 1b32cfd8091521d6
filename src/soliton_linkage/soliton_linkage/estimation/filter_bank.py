# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the Kalman filters of a `MultipleModelFilter`.

The state of each filter is (s, w, b, d): arc length s along the orbit, its rate w, bias b of the
measurement, and disturbance d. The meaning of d depends on `FilterSettings.disturbance`, the prior
standard deviation of an unmodelled acceleration. If it is above 0, d is this acceleration
[rad/s^2]. If it is 0, unmodelled damping causes the acceleration d w. Then d is a rate [1/s], and
negative if the motion is damped.

The steady filter assumes that the rate has no random changes, and that the measurement has no
bias. Other filters allow random changes and a bias, or assume that an impulse has acted.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compile_loop, compiled, const_f8_1d, f8, i8, records
from soliton_linkage.estimation.settings import FilterSettings, record_dtype
from soliton_linkage.linkage.chain import Array

Records = NDArray[np.void]

_LEAST_EVIDENCE = 0.5
"""A filter that assumes an impulse has the weight 0 unless its `odds` are above this [1].
Sensitivity: at -inf, the reported standard deviations in steady motion increase by 3 %. In a few
records, each a few hundred frames long, they are then twice as large."""

ARC, RATE, BIAS, DISTURBANCE = range(4)
FILTER = np.dtype(
    [
        ('state', np.float64, (4,)),
        ('covariance', np.float64, (4, 4)),
        *(
            (name, np.float64)
            for name in (
                *('bias_variance', 'rate_noise', 'weight', 'prior'),
                *('probability', 'likelihood', 'odds'),
            )
        ),
    ]
)
"""Record of one filter. The first filter of a bank is the steady filter. Each of the last filters
assumes one impulse; they are sorted from the latest to the earliest impulse.

state, covariance: mean and covariance of (s, w, b, d).
bias_variance: stationary variance of the bias [rad^2].
rate_noise: square of the random relative change of the rate per rotor spacing [1].
weight: weight of the filter in the mixture of all filters [1].
prior, probability: prior and current probability of the filter; both are 0 for the steady filter
    and for filters that assume an impulse, and have the sum 1 over the other filters [1].
likelihood: log likelihood of recent measurements, minus that of the likeliest filter [1].
odds: log likelihood of the measurements since the assumed impulse, minus the log likelihood of the
    same measurements for the filters that assume no impulse [1].
"""
STATUS = np.dtype(
    [
        (name, np.float64)
        for name in (
            *('base', 'site_arc', 'least_impulse', 'bias_decay', 'variance', 'elapsed'),
            *('rate', 'log_odds', 'frames', 'impulses', 'wave_noise', 'ripple'),
        )
    ]
)
"""Record of the state of the whole bank of filters.

base: number of filters that assume no impulse [1].
site_arc: arc length per rotor spacing [rad].
least_impulse: assumed variance of the rate change that an impulse causes in a wall at rest
    [rad^2/s^2].
bias_decay: decay rate of the bias while the wall is at rest [1/s]; while the wall moves, the bias
    also decays with the distance that the wall has moved.
variance: variance of the last measurement [rad^2].
elapsed: time step of the last prediction [s].
rate: mean rate of the arc length in the mixture of all filters [rad/s].
log_odds: log odds against the steady filter: logarithm of the total weight of the other filters
    that assume no impulse, divided by the weight of the steady filter [1].
frames: number of frames since the last restart from an impulse [1].
impulses: number of restarts from an impulse [1].
wave_noise: spectral density of the random acceleration by waves, divided by the `rate_noise` of
    the filter [rad^2/s^3].
ripple: variance added to the stationary variance of the bias, `bias_variance`, of each filter
    [rad^2]. It replaces the ripple, which is the part of the rate that is periodic in the site of
    the wall.
"""
_FILTERS = records(FILTER, writable=True)
_STATUS = records(STATUS, writable=True)
_NUMBERS = records(record_dtype(FilterSettings))


def _transform(transition: Array, covariance: Array, product: Array) -> None:
    """Replace the covariance P by F P F^T; F is `transition`; `product` is overwritten."""
    for i in range(4):
        for j in range(4):
            total = 0.0
            for k in range(4):
                total += transition[i, k] * covariance[k, j]
            product[i, j] = total
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                total += product[i, k] * transition[j, k]
            covariance[i, j] = covariance[j, i] = total


def _correct(covariance: Array, cross: Array, whole: float) -> None:
    for i in range(4):
        for j in range(4):
            covariance[i, j] -= cross[i] * cross[j] / whole


transform = compile_loop(_transform, inlined=True)
correct = compile_loop(_correct, inlined=True)


@compiled(_FILTERS)
def expected_measurement(filters: Records) -> tuple[float, float]:
    """Return the mean [rad] and variance [rad^2] of s + b in the mixture of all filters."""
    arc, variance = 0.0, 0.0
    for n in range(filters.size):
        state = filters[n]['state']
        arc += filters[n]['weight'] * (state[ARC] + state[BIAS])
    for n in range(filters.size):
        state, covariance = filters[n]['state'], filters[n]['covariance']
        apart = state[ARC] + state[BIAS] - arc
        own = covariance[ARC, ARC] + 2 * covariance[ARC, BIAS] + covariance[BIAS, BIAS]
        variance += filters[n]['weight'] * (own + apart * apart)
    return arc, variance


@compiled(_FILTERS, _STATUS, _NUMBERS, f8, f8, f8, f8, f8)
def predict(
    filters: Records,
    status: Records,
    settings: Records,
    elapsed: float,
    exchange: float,
    ratio: float,
    acceleration: float,
    bandwidth: float,
) -> tuple[float, float]:
    """Predict all filters as `MultipleModelFilter.predict`; return `expected_measurement`."""
    status[0]['elapsed'] = elapsed
    speed, site = abs(status[0]['rate']), status[0]['site_arc']
    way = speed * elapsed / site
    kept = math.exp(-way / settings[0]['bias_way'] - elapsed * status[0]['bias_decay'])
    remembered = math.exp(-way / settings[0]['memory_way'])
    unknown = (bandwidth * elapsed) ** 2 * status[0]['variance']
    transition, product = np.zeros((4, 4)), np.empty((4, 4))
    transition[ARC, ARC], transition[ARC, RATE] = 1.0, elapsed
    transition[BIAS, BIAS], transition[DISTURBANCE, DISTURBANCE] = kept, 1.0
    damping, base = settings[0]['disturbance'] == 0, int(status[0]['base'])
    for n in range(filters.size):
        each = filters[n]
        state, covariance = each['state'], each['covariance']
        covariance[ARC, ARC] += 3 * unknown
        covariance[RATE, RATE] += 3 * bandwidth**2 * unknown
        covariance[DISTURBANCE, DISTURBANCE] += bandwidth**4 * unknown
        lever = state[RATE] if damping else 1.0
        transition[ARC, DISTURBANCE] = lever * elapsed * elapsed / 2
        transition[RATE, DISTURBANCE] = ratio * lever * elapsed
        gained = elapsed * (acceleration + lever * state[DISTURBANCE])
        transition[RATE, RATE] = ratio * (1 + elapsed * state[DISTURBANCE] * damping)
        state[ARC] += elapsed * (state[RATE] + gained / 2)
        state[RATE] = ratio * (state[RATE] + gained)
        state[BIAS] *= kept
        each['likelihood'] *= remembered
        transform(transition, covariance, product)
        noise = each['rate_noise']
        if 0 < n < base:
            noise = (math.sqrt(noise) + exchange) ** 2
        added = (speed**3 / site + status[0]['wave_noise']) * elapsed * noise
        covariance[ARC, ARC] += elapsed**2 / 3 * added
        covariance[ARC, RATE] += ratio * elapsed / 2 * added
        covariance[RATE, ARC] = covariance[ARC, RATE]
        covariance[RATE, RATE] += ratio**2 * added
        biased = each['bias_variance'] + status[0]['ripple']
        covariance[BIAS, BIAS] += biased * (1 - kept**2)
    return expected_measurement(filters)


@compiled(_FILTERS, f8, f8, f8)
def _update_filters(filters: Records, arc: float, variance: float, freedoms: float) -> Array:
    likely, cross = np.empty(filters.size), np.empty(4)
    for n in range(filters.size):
        state, covariance = filters[n]['state'], filters[n]['covariance']
        for i in range(4):
            cross[i] = covariance[i, ARC] + covariance[i, BIAS]
        whole = cross[ARC] + cross[BIAS] + variance
        innovation = arc - (state[ARC] + state[BIAS])
        square = innovation * innovation / whole
        if freedoms < math.inf:
            square = (freedoms + 1) * math.log1p(square / freedoms)
        likely[n] = -0.5 * (square + math.log(whole))
        for i in range(4):
            state[i] += cross[i] / whole * innovation
        correct(covariance, cross, whole)
    return likely


@compiled(const_f8_1d, const_f8_1d)
def _log_mean(probabilities: Array, likelihoods: Array) -> float:
    # Skip filters with zero weight: their likelihood may be so large that exp overflows.
    top = -math.inf
    for n in range(probabilities.size):
        if probabilities[n] > 0:
            top = max(top, likelihoods[n])
    mean, whole = 0.0, 0.0
    for n in range(probabilities.size):
        if probabilities[n] > 0:
            mean += probabilities[n] * math.exp(likelihoods[n] - top)
            whole += probabilities[n]
    return float(top + math.log(mean / whole))


@compiled(_FILTERS, i8, f8, f8, f8)
def update(
    filters: Records, base: int, arc: float, variance: float, freedoms: float
) -> tuple[float, float]:
    """Update all filters and their probabilities with a measured arc length [rad].

    `base` is as in `STATUS`. `variance` is the variance of the measurement [rad^2], and `freedoms`
    the number of degrees of freedom of this variance. Return the change of the log odds against
    the steady filter, and the largest `odds` of a filter that assumes an impulse.
    """
    likely = _update_filters(filters, arc, variance, freedoms)
    probabilities, weights = np.empty(base - 1), np.empty(base)
    for n in range(base):
        weights[n] = filters[n]['weight']
        if n > 0:
            probabilities[n - 1] = filters[n]['probability']
    ratio = _log_mean(probabilities, likely[1:base]) - likely[0] if base > 1 else 0.0
    together = _log_mean(weights, likely[:base])
    most = -math.inf
    for n in range(base, filters.size):
        filters[n]['odds'] += likely[n] - together
        most = max(most, filters[n]['odds'])
    top, whole = -math.inf, 0.0
    for n in range(1, base):
        filters[n]['likelihood'] += likely[n]
        top = max(top, filters[n]['likelihood'])
    for n in range(1, base):
        filters[n]['likelihood'] -= top
        filters[n]['probability'] = filters[n]['prior'] * math.exp(filters[n]['likelihood'])
        whole += filters[n]['probability']
    for n in range(1, base):
        filters[n]['probability'] /= whole
    return ratio, most


@compiled(_FILTERS, _NUMBERS, i8, f8)
def set_weights(filters: Records, settings: Records, base: int, log_odds: float) -> None:
    """Set the weights of all filters in the mixture; `base` and `log_odds` are as in `STATUS`."""
    doubted = 1 / (1 + math.exp(-log_odds))
    filters[0]['weight'] = 1 - doubted
    for n in range(1, base):
        filters[n]['weight'] = doubted * filters[n]['probability']
    if base < filters.size:
        filters[base]['weight'] = 0.0
    for n in range(base + 1, filters.size):
        beyond = math.exp(filters[n]['odds']) - math.exp(_LEAST_EVIDENCE)
        filters[n]['weight'] = math.exp(-settings[0]['impulse_rarity']) * max(beyond, 0.0)
    whole = 0.0
    for n in range(filters.size):
        whole += filters[n]['weight']
    for n in range(filters.size):
        filters[n]['weight'] /= whole


@compiled(_FILTERS, i8)
def mixture(filters: Records, count: int) -> tuple[float, float, float, float, float]:
    """Return means of s and w, var(s), cov(s, w) and var(w) for the first `count` filters."""
    whole, arc, rate = 0.0, 0.0, 0.0
    of_arc, both, of_rate = 0.0, 0.0, 0.0
    for n in range(count):
        weight = filters[n]['weight']
        whole += weight
        arc += weight * filters[n]['state'][ARC]
        rate += weight * filters[n]['state'][RATE]
        of_arc += weight * filters[n]['covariance'][ARC, ARC]
        both += weight * filters[n]['covariance'][ARC, RATE]
        of_rate += weight * filters[n]['covariance'][RATE, RATE]
    arc, rate = arc / whole, rate / whole
    for n in range(count):
        weight = filters[n]['weight']
        arcs, rates = filters[n]['state'][ARC] - arc, filters[n]['state'][RATE] - rate
        of_arc += weight * arcs * arcs
        both += weight * arcs * rates
        of_rate += weight * rates * rates
    return arc, rate, of_arc / whole, both / whole, of_rate / whole


@compiled(_FILTERS, i8, i8)
def _copy_state(filters: Records, source: int, target: int) -> None:
    one, other = filters[source], filters[target]
    # Assignments of slices would take seconds to compile.
    for i in range(one['state'].size):
        other['state'][i] = one['state'][i]
        for j in range(one['state'].size):
            other['covariance'][i, j] = one['covariance'][i, j]
    other['bias_variance'] = one['bias_variance']


@compiled(_FILTERS, i8, i8, f8, f8)
def assume_impulse(
    filters: Records, base: int, older: int, elapsed: float, least_impulse: float
) -> None:
    """Insert at index `base` a filter that assumes an impulse in the last time step.

    Before that, a number of filters, `older`, are moved from index `base` and the next indices to
    the indices that follow; the filter at index `base` + `older` is overwritten. The new filter is
    a copy of the filter with the largest weight among those that assume no impulse, but with
    larger variances of the arc length and of the rate. `elapsed` is the time step [s], and
    `least_impulse` is as in `STATUS`.
    """
    likeliest = 0
    for n in range(1, base):
        if filters[n]['weight'] > filters[likeliest]['weight']:
            likeliest = n
    for age in range(older, 0, -1):
        _copy_state(filters, base + age - 1, base + age)
        filters[base + age]['odds'] = filters[base + age - 1]['odds']
    _copy_state(filters, likeliest, base)
    change = filters[base]['state'][RATE] ** 2 + least_impulse
    filters[base]['covariance'][ARC, ARC] += change * elapsed**2 / 4
    filters[base]['covariance'][RATE, RATE] += change
    filters[base]['odds'] = 0.0


@compiled(_FILTERS, i8)
def restart_steady(filters: Records, base: int) -> None:
    """Restart the steady filter, with bias 0, from the mixture of filters 1 to `base` - 1."""
    filters[0]['weight'] = 0.0
    disturbance, of_disturbance = 0.0, 0.0
    for n in range(1, base):
        weight = filters[n]['probability']
        filters[n]['weight'] = weight
        disturbance += weight * filters[n]['state'][DISTURBANCE]
        of_disturbance += weight * filters[n]['covariance'][DISTURBANCE, DISTURBANCE]
    arc, rate, of_arc, both, of_rate = mixture(filters, base)
    state, covariance = filters[0]['state'], filters[0]['covariance']
    state[ARC], state[RATE], state[BIAS], state[DISTURBANCE] = arc, rate, 0.0, disturbance
    covariance[:] = 0.0
    covariance[ARC, ARC], covariance[RATE, RATE] = of_arc, of_rate
    covariance[ARC, RATE] = covariance[RATE, ARC] = both
    covariance[DISTURBANCE, DISTURBANCE] = of_disturbance


@compiled(_FILTERS, i8)
def restart_from_impulse(filters: Records, base: int) -> None:
    """Restart all filters that assume no impulse from the filter with the largest `odds`.

    Each bias becomes 0 and gets the stationary variance of its filter. All `odds` become -inf.
    """
    likeliest = base
    for n in range(base, filters.size):
        if filters[n]['odds'] > filters[likeliest]['odds']:
            likeliest = n
    for n in range(base):
        variance = filters[n]['bias_variance']
        _copy_state(filters, likeliest, n)
        filters[n]['bias_variance'] = variance
        filters[n]['state'][BIAS] = 0.0
        for i in range(4):
            filters[n]['covariance'][i, BIAS] = filters[n]['covariance'][BIAS, i] = 0.0
        filters[n]['covariance'][BIAS, BIAS] = variance
    for n in range(base, filters.size):
        filters[n]['odds'] = -math.inf


@compiled(_FILTERS, _STATUS, _NUMBERS, f8, f8, f8, f8)
def measure(
    filters: Records,
    status: Records,
    settings: Records,
    arc: float,
    variance: float,
    freedoms: float,
    calm: float,
) -> tuple[float, float, float, float, float]:
    """Update all filters as `MultipleModelFilter.update` does, and return their `mixture`."""
    given, now = settings[0], status[0]
    base, frames = int(now['base']), int(now['frames'])
    more, most = update(filters, base, arc, variance, freedoms)
    log_odds = max(now['log_odds'] + more, -given['impulse_rarity'] * calm)
    if log_odds >= given['restart_odds']:
        restart_steady(filters, base)
        log_odds = given['restart_odds'] - 1
    if most > given['decisive_odds']:
        restart_from_impulse(filters, base)
        log_odds = max(log_odds, given['restart_odds'] - 1)
        frames = 0
        now['impulses'] += 1
    frames += 1
    older, ages = 0, filters.size - base
    while older < ages - 1 and frames % (2 << older) == 0:
        older += 1
    set_weights(filters, settings, base, log_odds)
    if ages > 0:
        assume_impulse(filters, base, older, now['elapsed'], now['least_impulse'])
    now['log_odds'], now['frames'], now['variance'] = log_odds, frames, variance
    mixed = mixture(filters, filters.size)
    now['rate'] = mixed[1]
    return mixed
