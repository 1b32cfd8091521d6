# SPDX-License-Identifier: Apache-2.0
"""Loops over the Kalman filters of a `MultipleModelFilter`.

Filters are records, shape (F,): the B without a kick, of which the first is the steady one, and
after them those with one, of the shortest age first.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import COUNT, NUMBER, READ, YES, compiled, records, unrolled
from soliton_linkage.estimation.settings import FilterSettings, record_dtype
from soliton_linkage.linkage.chain import Array

Records = NDArray[np.void]

COVARIANCE = (
    *('arc_arc', 'arc_rate', 'arc_bias', 'arc_disturbance', 'rate_rate', 'rate_bias'),
    *('rate_disturbance', 'bias_bias', 'bias_disturbance', 'disturbance_disturbance'),
)
STATE = ('arc', 'rate', 'bias', 'disturbance', *COVARIANCE)
MODEL = ('bias_variance', 'wander', 'wander_at_edges')
EVIDENCE = ('weight', 'share', 'likelihood', 'odds')
FILTER = np.dtype([(name, np.float64) for name in (*STATE, *MODEL, *EVIDENCE)])
"""State (s, w, b, d) of a filter, its covariance, its model and what speaks for it.

The arc s [rad], its rate w [rad/s], the bias b of the measurement [rad] and the disturbance d
[rad/s^2]; products of their units. Of the model the variance m^2 that the bias comes back to
[rad^2], and e^2 [1] inside and at edges. The weight [1] is that in the mixture; share [1] and
logarithmic likelihood are those among the filters that are neither steady nor of a kick,
logarithmic odds those of a kick.
"""
_READ_FILTERS = records(FILTER)
_FILTERS = records(FILTER, writable=True)
_NUMBERS = records(record_dtype(FilterSettings))


@compiled(_READ_FILTERS)
def expected_measurement(filters: Records) -> tuple[float, float]:
    """Measurement s + b that weighted filters expect [rad] and its variance [rad^2]."""
    arc, variance = 0.0, 0.0
    for n in range(filters.size):
        each = filters[n]
        arc += each['weight'] * (each['arc'] + each['bias'])
    for n in range(filters.size):
        each = filters[n]
        apart = each['arc'] + each['bias'] - arc
        of_filter = each['arc_arc'] + 2 * each['arc_bias'] + each['bias_bias']
        variance += each['weight'] * (of_filter + apart * apart)
    return arc, variance


@compiled(_FILTERS, NUMBER, NUMBER, NUMBER, NUMBER, YES, NUMBER, NUMBER, NUMBER, NUMBER)
def predict(
    filters: Records,
    elapsed: float,
    kept: float,
    cubed: float,
    remembered: float,
    at_edge: bool,
    ratio: float,
    acceleration: float,
    bandwidth: float,
    unsure: float,
) -> tuple[float, float]:
    """Let filters go on by a time [s], of whose bias b the share e^(-|w| dt / ...) is kept.

    The rates wander with the variance cubed * e^2 in a second, are accelerated [rad/s^2], and are
    in the end what they were times a ratio; a share of the logarithmic likelihoods is remembered.
    A bandwidth [rad/s] and a variance [rad^2] are those of what is unknown beside. Returns
    `expected_measurement`.
    """
    for n in range(filters.size):
        each = filters[n]
        each['arc_arc'] += 3 * unsure
        each['rate_rate'] += 3 * bandwidth**2 * unsure
        each['disturbance_disturbance'] += bandwidth**4 * unsure
        gained = elapsed * (acceleration + each['disturbance'])
        each['arc'] += elapsed * (each['rate'] + gained / 2)
        each['rate'] = ratio * (each['rate'] + gained)
        each['bias'] *= kept
        each['likelihood'] *= remembered
        added = cubed * elapsed * (each['wander_at_edges'] if at_edge else each['wander'])
        both, of_rate = each['arc_rate'], each['rate_rate']
        arc_before, rate_before = each['arc_disturbance'], each['rate_disturbance']
        of_gain = elapsed * each['disturbance_disturbance']
        with_rate = rate_before + of_gain
        with_arc = arc_before + elapsed * (rate_before + of_gain / 2)
        more = elapsed / 2 * (arc_before + with_arc + elapsed * rate_before)
        each['arc_arc'] += elapsed * (2 * both + elapsed * of_rate + more) + elapsed**2 / 3 * added
        more = elapsed * (with_arc + elapsed / 2 * rate_before)
        each['arc_rate'] = ratio * (both + elapsed * of_rate + more + elapsed / 2 * added)
        bias_gain = elapsed * each['bias_disturbance']
        each['arc_bias'] += elapsed * (each['rate_bias'] + bias_gain / 2)
        each['arc_bias'] *= kept
        each['arc_disturbance'] = with_arc
        of_rate += elapsed * (rate_before + with_rate)
        each['rate_rate'] = ratio * ratio * (of_rate + added)
        each['rate_bias'] = ratio * kept * (each['rate_bias'] + bias_gain)
        each['rate_disturbance'] = ratio * with_rate
        each['bias_bias'] = kept**2 * each['bias_bias'] + each['bias_variance'] * (1 - kept**2)
        each['bias_disturbance'] *= kept
    return expected_measurement(filters)


@compiled(_FILTERS, NUMBER, NUMBER, NUMBER)
def _update_filters(
    filters: Records, arc: float, variance: float, degrees_of_freedom: float
) -> Array:
    """Update each filter; return how likely [logarithm] it made the measurement, shape (F,)."""
    likely = np.empty(filters.size)
    for n in range(filters.size):
        each = filters[n]
        of_arc = each['arc_arc'] + each['arc_bias']
        of_rate = each['arc_rate'] + each['rate_bias']
        of_bias = each['arc_bias'] + each['bias_bias']
        of_force = each['arc_disturbance'] + each['bias_disturbance']
        whole = of_arc + of_bias + variance
        innovation = arc - (each['arc'] + each['bias'])
        square = innovation * innovation / whole
        if degrees_of_freedom < math.inf:
            square = (degrees_of_freedom + 1) * math.log1p(square / degrees_of_freedom)
        likely[n] = -0.5 * (square + math.log(whole))
        by_arc, by_rate = of_arc / whole, of_rate / whole
        by_bias, by_force = of_bias / whole, of_force / whole
        each['arc'] += by_arc * innovation
        each['rate'] += by_rate * innovation
        each['bias'] += by_bias * innovation
        each['disturbance'] += by_force * innovation
        each['arc_arc'] -= of_arc * by_arc
        each['arc_rate'] -= of_arc * by_rate
        each['arc_bias'] -= of_arc * by_bias
        each['rate_rate'] -= of_rate * by_rate
        each['rate_bias'] -= of_rate * by_bias
        each['bias_bias'] -= of_bias * by_bias
        each['arc_disturbance'] -= of_arc * by_force
        each['rate_disturbance'] -= of_rate * by_force
        each['bias_disturbance'] -= of_bias * by_force
        each['disturbance_disturbance'] -= of_force * by_force
    return likely


@compiled(READ, READ)
def _together(shares: Array, likelihoods: Array) -> float:
    """Logarithm of the mean of likelihoods [logarithm] by their shares."""
    # One without a share may be likelier than all others by more than exponentials can tell.
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


@compiled(_FILTERS, COUNT, NUMBER, NUMBER, NUMBER)
def update(
    filters: Records, base: int, arc: float, variance: float, degrees_of_freedom: float
) -> tuple[float, float]:
    """Update all filters by a measurement of the arc [rad], whose variance is of few freedoms.

    Weights are those of before; shares, likelihoods and odds are brought up to date. Returns how
    much less likely [logarithm] the steady filter makes the measurement than the other base - 1
    do, and the largest of the odds of a kick.
    """
    likely = _update_filters(filters, arc, variance, degrees_of_freedom)
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


@compiled(_FILTERS, _NUMBERS, COUNT, NUMBER)
def set_weights(filters: Records, settings: Records, base: int, against: float) -> None:
    """Set the weights of all filters.

    The steady one has the logarithmic odds against it; those of kicks, which are rare, count
    from some odds for them on, but for the youngest: of one measurement noise may make anything.
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


@compiled(_READ_FILTERS, COUNT)
def mixture(filters: Records, count: int) -> tuple[float, float, float, float, float]:
    """Mean s and w of the first weighted filters, variance of s, covariance, variance of w."""
    whole, arc, rate = 0.0, 0.0, 0.0
    of_arc, both, of_rate = 0.0, 0.0, 0.0
    for n in range(count):
        each = filters[n]
        weight = each['weight']
        whole += weight
        arc += weight * each['arc']
        rate += weight * each['rate']
        of_arc += weight * each['arc_arc']
        both += weight * each['arc_rate']
        of_rate += weight * each['rate_rate']
    arc, rate = arc / whole, rate / whole
    for n in range(count):
        each = filters[n]
        weight = each['weight']
        arcs, rates = each['arc'] - arc, each['rate'] - rate
        of_arc += weight * arcs * arcs
        both += weight * arcs * rates
        of_rate += weight * rates * rates
    return arc, rate, of_arc / whole, both / whole, of_rate / whole


@compiled(_FILTERS, COUNT, COUNT)
def _copy_state(filters: Records, source: int, target: int) -> None:
    """Let a filter have the state, the covariance and the bias variance of another."""
    one, other = filters[source], filters[target]
    for name in unrolled(STATE):
        other[name] = one[name]
    other['bias_variance'] = one['bias_variance']


@compiled(_FILTERS, COUNT, COUNT, NUMBER, NUMBER)
def suppose_kick(
    filters: Records, base: int, older: int, elapsed: float, least_kick: float
) -> None:
    """Let the filter begin that holds that the wall is kicked now; some grow older.

    It goes on from the likeliest without a kick, the rate being changed by about itself and the
    least, a variance [rad^2/s^2], somewhere in the time [s] since the last frame.
    """
    likeliest = 0
    for n in range(1, base):
        if filters[n]['weight'] > filters[likeliest]['weight']:
            likeliest = n
    for age in range(older, 0, -1):
        _copy_state(filters, base + age - 1, base + age)
        filters[base + age]['odds'] = filters[base + age - 1]['odds']
    _copy_state(filters, likeliest, base)
    kicked = filters[base]
    kick = kicked['rate'] ** 2 + least_kick
    kicked['arc_arc'] += kick * elapsed**2 / 4
    kicked['rate_rate'] += kick
    kicked['odds'] = 0.0


@compiled(_FILTERS, COUNT)
def begin_steady(filters: Records, base: int) -> None:
    """Let the steady filter begin anew where the others are."""
    filters[0]['weight'] = 0.0
    for n in range(1, base):
        filters[n]['weight'] = filters[n]['share']
    arc, rate, of_arc, both, of_rate = mixture(filters, base)
    steady = filters[0]
    for name in unrolled(STATE):
        steady[name] = 0.0
    for n in range(1, base):
        each = filters[n]
        steady['disturbance'] += each['weight'] * each['disturbance']
        steady['disturbance_disturbance'] += each['weight'] * each['disturbance_disturbance']
    steady['arc'], steady['rate'] = arc, rate
    steady['arc_arc'], steady['arc_rate'], steady['rate_rate'] = of_arc, both, of_rate


@compiled(_FILTERS, COUNT)
def begin_kicked(filters: Records, base: int) -> None:
    """Let all filters begin anew where the likeliest kick has led."""
    likeliest = base
    for n in range(base, filters.size):
        if filters[n]['odds'] > filters[likeliest]['odds']:
            likeliest = n
    for n in range(base):
        variance = filters[n]['bias_variance']
        _copy_state(filters, likeliest, n)
        filters[n]['bias_variance'] = filters[n]['bias_bias'] = variance
        filters[n]['bias'] = filters[n]['arc_bias'] = filters[n]['rate_bias'] = 0.0
        filters[n]['bias_disturbance'] = 0.0
    for n in range(base, filters.size):
        filters[n]['odds'] = -math.inf


@compiled(_FILTERS, _NUMBERS, COUNT, *(NUMBER,) * 4, YES, COUNT, NUMBER, NUMBER, NUMBER)
def measure(
    filters: Records,
    settings: Records,
    base: int,
    arc: float,
    variance: float,
    degrees_of_freedom: float,
    against: float,
    at_edge: bool,
    frames: int,
    elapsed: float,
    least_kick: float,
    calm: float,
) -> tuple[tuple[float, int], tuple[float, float, float, float, float]]:
    """Take in a measurement of the arc [rad]: `update`, `set_weights`, `suppose_kick`, `mixture`.

    Against the steady filter are logarithmic odds, since so many frames ago all followed a kick.
    Filters of a kick in the last 2^k frames and more move on when the count of frames is a
    multiple of 2^(k + 1). The less calm the chain is, from 0 to 1, the less the steady filter may
    be believed. Returns the odds and the frames as they are now, and the mixture.
    """
    given = settings[0]
    more, most = update(filters, base, arc, variance, degrees_of_freedom)
    least = given['least_odds_at_edges'] if at_edge else given['least_odds']
    against = max(against + more, least * calm)
    if against >= given['odds_of_doubt']:
        begin_steady(filters, base)
        against = given['odds_begun_anew']
    if most > given['kick_beyond_chance']:
        begin_kicked(filters, base)
        against = max(against, given['odds_begun_anew'])
        frames = 0
    frames += 1
    older, ages = 0, filters.size - base
    while older < ages - 1 and frames % (2 << older) == 0:
        older += 1
    set_weights(filters, settings, base, against)
    if ages > 0:
        suppose_kick(filters, base, older, elapsed, least_kick)
    return (against, frames), mixture(filters, filters.size)
