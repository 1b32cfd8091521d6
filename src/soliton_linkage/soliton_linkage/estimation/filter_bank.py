# SPDX-License-Identifier: Apache-2.0
"""Compiled Kalman filters of a `MultipleModelFilter`, by matrices of its state (s, w, b, d)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    b1,
    compile_loop,
    compiled,
    const_f8_1d,
    f8,
    i8,
    records,
)
from soliton_linkage.estimation.settings import FilterSettings, record_dtype
from soliton_linkage.linkage.chain import Array

Records = NDArray[np.void]

ARC, RATE, BIAS, DISTURBANCE = range(4)
FILTER = np.dtype(
    [
        ('state', np.float64, (4,)),
        ('covariance', np.float64, (4, 4)),
        *(
            (name, np.float64)
            for name in (
                *('bias_variance', 'wander', 'wander_at_edges'),
                *('weight', 'share', 'likelihood', 'odds'),
            )
        ),
    ]
)
"""A filter: mean (s, w, b, d), covariance, model and evidence.

Variance m^2 that the bias returns to [rad^2] and e^2 [1], inside and at edges. Weight in the
mixture [1]; share [1] and log likelihood among the filters that are neither steady nor of an
impulse; log odds of an impulse. The steady filter is the first; those of an impulse are the last,
the youngest first.
"""
STATUS = np.dtype(
    [
        (name, np.float64)
        for name in (
            *('base', 'site_arc', 'least_kick', 'variance', 'elapsed', 'at_edge', 'rate'),
            *('against', 'frames', 'kicks'),
        )
    ]
)
"""What all filters share: how many have no impulse, arc of a site [rad], least variance of an
impulse [rad^2/s^2], variance of the last measurement [rad^2], time step [s], whether the wall is
at an edge, rate of the mixture [rad/s], log odds against the steady filter, frames since all
restarted from an impulse, and how often they did."""
_FILTERS = records(FILTER, writable=True)
_STATUS = records(STATUS, writable=True)
_NUMBERS = records(record_dtype(FilterSettings))


def _transform(transition: Array, covariance: Array, product: Array) -> None:
    """Set a covariance P to F P F^T, by way of the product F P; shape (4, 4) each."""
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
    """Subtract the outer product of a cross covariance, shape (4,), over the whole variance."""
    for i in range(4):
        for j in range(4):
            covariance[i, j] -= cross[i] * cross[j] / whole


transform = compile_loop(_transform, inlined=True)
correct = compile_loop(_correct, inlined=True)


@compiled(_FILTERS)
def expected_measurement(filters: Records) -> tuple[float, float]:
    """Return the measurement s + b that the mixture expects [rad], and its variance [rad^2]."""
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


@compiled(_FILTERS, _STATUS, _NUMBERS, f8, b1, f8, f8, f8)
def predict(
    filters: Records,
    status: Records,
    settings: Records,
    elapsed: float,
    at_edge: bool,
    ratio: float,
    acceleration: float,
    bandwidth: float,
) -> tuple[float, float]:
    """Predict all filters; return the `expected_measurement`.

    See `MultipleModelFilter.predict`.
    """
    status[0]['elapsed'], status[0]['at_edge'] = elapsed, at_edge
    speed, site = abs(status[0]['rate']), status[0]['site_arc']
    way = speed * elapsed / site
    kept = math.exp(-way / settings[0]['bias_way'])
    remembered = math.exp(-way / settings[0]['way_remembered'])
    unknown = (bandwidth * elapsed) ** 2 * status[0]['variance']
    transition, product = np.zeros((4, 4)), np.empty((4, 4))
    transition[ARC, ARC], transition[ARC, RATE] = 1.0, elapsed
    transition[ARC, DISTURBANCE] = elapsed * elapsed / 2
    transition[RATE, RATE], transition[RATE, DISTURBANCE] = ratio, ratio * elapsed
    transition[BIAS, BIAS], transition[DISTURBANCE, DISTURBANCE] = kept, 1.0
    for n in range(filters.size):
        each = filters[n]
        state, covariance = each['state'], each['covariance']
        covariance[ARC, ARC] += 3 * unknown
        covariance[RATE, RATE] += 3 * bandwidth**2 * unknown
        covariance[DISTURBANCE, DISTURBANCE] += bandwidth**4 * unknown
        gained = elapsed * (acceleration + state[DISTURBANCE])
        state[ARC] += elapsed * (state[RATE] + gained / 2)
        state[RATE] = ratio * (state[RATE] + gained)
        state[BIAS] *= kept
        each['likelihood'] *= remembered
        transform(transition, covariance, product)
        wander = each['wander_at_edges'] if at_edge else each['wander']
        added = speed**3 / site * elapsed * wander
        covariance[ARC, ARC] += elapsed**2 / 3 * added
        covariance[ARC, RATE] += ratio * elapsed / 2 * added
        covariance[RATE, ARC] = covariance[ARC, RATE]
        covariance[RATE, RATE] += ratio**2 * added
        covariance[BIAS, BIAS] += each['bias_variance'] * (1 - kept**2)
    return expected_measurement(filters)


@compiled(_FILTERS, f8, f8, f8)
def _update_filters(filters: Records, arc: float, variance: float, freedoms: float) -> Array:
    """Update each filter; return the log likelihood of the measurement by each, shape (F,)."""
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
def _together(shares: Array, likelihoods: Array) -> float:
    """Logarithm of the mean of likelihoods [logarithm] by their shares."""
    # A filter without a share may be likelier than all others by more than exponentials hold.
    top = -math.inf
    for n in range(shares.size):
        if shares[n] > 0:
            top = max(top, likelihoods[n])
    mean, whole = 0.0, 0.0
    for n in range(shares.size):
        if shares[n] > 0:
            mean += shares[n] * math.exp(likelihoods[n] - top)
            whole += shares[n]
    return float(top + math.log(mean / whole))


@compiled(_FILTERS, i8, f8, f8, f8)
def update(
    filters: Records, base: int, arc: float, variance: float, freedoms: float
) -> tuple[float, float]:
    """Update all filters with their shares, likelihoods and odds, by the weights of before.

    Returns how much less likely [logarithm] the steady filter makes the measurement than the
    other base - 1 do, and the largest of the log odds of an impulse.
    """
    likely = _update_filters(filters, arc, variance, freedoms)
    shares, weights = np.empty(base - 1), np.empty(base)
    for n in range(base):
        weights[n] = filters[n]['weight']
        if n > 0:
            shares[n - 1] = filters[n]['share']
    against = _together(shares, likely[1:base]) - likely[0] if base > 1 else 0.0
    together = _together(weights, likely[:base])
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
        filters[n]['share'] = math.exp(filters[n]['likelihood'])
        whole += filters[n]['share']
    for n in range(1, base):
        filters[n]['share'] /= whole
    return against, most


@compiled(_FILTERS, _NUMBERS, i8, f8)
def set_weights(filters: Records, settings: Records, base: int, against: float) -> None:
    """Set all weights, with the log odds against the steady filter.

    Filters of an impulse count from some odds on, but for the youngest: noise can explain any
    single measurement.
    """
    rarity, evidence = settings[0]['kick_rarity'], settings[0]['kick_evidence']
    doubted = 1 / (1 + math.exp(-against))
    filters[0]['weight'] = 1 - doubted
    for n in range(1, base):
        filters[n]['weight'] = doubted * filters[n]['share']
    if base < filters.size:
        filters[base]['weight'] = 0.0
    for n in range(base + 1, filters.size):
        beyond = max(math.exp(filters[n]['odds']) - math.exp(evidence), 0.0)
        filters[n]['weight'] = math.exp(-rarity) * beyond
    whole = 0.0
    for n in range(filters.size):
        whole += filters[n]['weight']
    for n in range(filters.size):
        filters[n]['weight'] /= whole


@compiled(_FILTERS, i8)
def mixture(filters: Records, count: int) -> tuple[float, float, float, float, float]:
    """Return means s and w of the first filters, variance of s, covariance, variance of w."""
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
    other['state'][:] = one['state']
    other['covariance'][:] = one['covariance']
    other['bias_variance'] = one['bias_variance']


@compiled(_FILTERS, i8, i8, f8, f8)
def suppose_impulse(
    filters: Records, base: int, older: int, elapsed: float, least_kick: float
) -> None:
    """Assume an impulse in this frame, and shift the filters up to an age by one place.

    The rate is unknown by its own size and the least kick [rad^2/s^2].
    """
    likeliest = 0
    for n in range(1, base):
        if filters[n]['weight'] > filters[likeliest]['weight']:
            likeliest = n
    for age in range(older, 0, -1):
        _copy_state(filters, base + age - 1, base + age)
        filters[base + age]['odds'] = filters[base + age - 1]['odds']
    _copy_state(filters, likeliest, base)
    kick = filters[base]['state'][RATE] ** 2 + least_kick
    filters[base]['covariance'][ARC, ARC] += kick * elapsed**2 / 4
    filters[base]['covariance'][RATE, RATE] += kick
    filters[base]['odds'] = 0.0


@compiled(_FILTERS, i8)
def restart_steady(filters: Records, base: int) -> None:
    """Restart the steady filter from the mean of the others, without a bias."""
    filters[0]['weight'] = 0.0
    disturbance, of_disturbance = 0.0, 0.0
    for n in range(1, base):
        weight = filters[n]['share']
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
    """Restart all filters from the likeliest impulse, each with a bias of its own model."""
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
    """Take a measurement after a prediction; return the mixture.

    Filters of an impulse in the last 2^k frames and more shift when the count of frames is a
    multiple of 2^(k + 1). See `MultipleModelFilter.update`.
    """
    given, now = settings[0], status[0]
    base, frames = int(now['base']), int(now['frames'])
    more, most = update(filters, base, arc, variance, freedoms)
    least = given['least_odds_at_edges'] if now['at_edge'] else given['least_odds']
    against = max(now['against'] + more, least * calm)
    if against >= given['odds_of_doubt']:
        restart_steady(filters, base)
        against = given['odds_of_doubt'] - 1
    if most > given['kick_beyond_chance']:
        restart_from_impulse(filters, base)
        against = max(against, given['odds_of_doubt'] - 1)
        frames = 0
        now['kicks'] += 1
    frames += 1
    older, ages = 0, filters.size - base
    while older < ages - 1 and frames % (2 << older) == 0:
        older += 1
    set_weights(filters, settings, base, against)
    if ages > 0:
        suppose_impulse(filters, base, older, now['elapsed'], now['least_kick'])
    now['against'], now['frames'], now['variance'] = against, frames, variance
    mixed = mixture(filters, filters.size)
    now['rate'] = mixed[1]
    return mixed
