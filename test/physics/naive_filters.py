# SPDX-License-Identifier: Apache-2.0
"""Naive twins, in numpy, of the loops over filters and encoders: same arguments."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops.filter_loops import COVARIANCE, Records
from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.linkage.chain import Array

STATE = ('arc', 'rate', 'bias', 'disturbance')
LOOKED = np.array([1.0, 0.0, 1.0, 0.0])
ROWS, COLUMNS = np.triu_indices(4)


def taken(filters: Records) -> tuple[Array, Array]:
    """States, shape (F, 4), and covariances, shape (F, 4, 4)."""
    covariances = np.empty((len(filters), 4, 4))
    for name, row, column in zip(COVARIANCE, ROWS, COLUMNS, strict=True):
        covariances[:, row, column] = covariances[:, column, row] = filters[name]
    return np.stack([filters[name] for name in STATE], axis=1), covariances


def put(filters: Records, states: Array, covariances: Array) -> None:
    for name, column in zip(STATE, states.T, strict=True):
        filters[name] = column
    for name, row, column in zip(COVARIANCE, ROWS, COLUMNS, strict=True):
        filters[name] = covariances[:, row, column]


def expected_measurement(filters: Records) -> tuple[float, float]:
    states, covariances = taken(filters)
    arcs, weights = states @ LOOKED, filters['weight']
    arc = float(weights @ arcs)
    variances = LOOKED @ covariances @ LOOKED
    return arc, float(weights @ (variances + (arcs - arc) ** 2))


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
    states, covariances = taken(filters)
    covariances = covariances + unsure * np.diag([3, 3 * bandwidth**2, 0, bandwidth**4])
    step = np.diag([1, 1, kept, 1])
    step[0, 1], step[:2, 3] = elapsed, (elapsed**2 / 2, elapsed)
    added = np.zeros_like(covariances)
    wander = cubed * filters['wander_at_edges' if at_edge else 'wander']
    added[:, 0, 0] = wander * elapsed**3 / 3
    added[:, 0, 1] = added[:, 1, 0] = wander * elapsed**2 / 2
    added[:, 1, 1] = wander * elapsed
    added[:, 2, 2] = filters['bias_variance'] * (1 - kept**2)
    filters['likelihood'] *= remembered
    states = states @ step.T + acceleration * np.array([elapsed**2 / 2, elapsed, 0, 0])
    covariances = step @ covariances @ step.T + added
    changed = np.diag([1.0, ratio, 1.0, 1.0])
    put(filters, states @ changed, changed @ covariances @ changed)
    return expected_measurement(filters)


def update(
    filters: Records, base: int, arc: float, variance: float, degrees_of_freedom: float
) -> tuple[float, float]:
    states, covariances = taken(filters)
    innovations = arc - states @ LOOKED
    variances = LOOKED @ covariances @ LOOKED + variance
    squares = innovations**2 / variances
    if math.isfinite(degrees_of_freedom):
        squares = (degrees_of_freedom + 1) * np.log1p(squares / degrees_of_freedom)
    likely = -0.5 * (squares + np.log(variances))
    against = together(filters['share'][1:base], likely[1:base]) - float(likely[0])
    filters['odds'][base:] += likely[base:] - together(filters['weight'][:base], likely[:base])
    likelihoods = filters['likelihood'][1:base]
    likelihoods += likely[1:base]
    likelihoods -= likelihoods.max()
    filters['share'][1:base] = np.exp(likelihoods) / np.exp(likelihoods).sum()
    gains = covariances @ LOOKED / variances[:, None]
    states = states + gains * innovations[:, None]
    put(filters, states, (np.eye(4) - gains[:, :, None] * LOOKED) @ covariances)
    return against, float(filters['odds'][base:].max())


def set_weights(filters: Records, settings: Records, base: int, against: float) -> None:
    weights, doubted = filters['weight'], 1 / (1 + math.exp(-against))
    weights[1:base] = doubted * filters['share'][1:base]
    weights[0] = 1 - doubted
    beyond = np.exp(filters['odds'][base:]) - np.exp(settings[0]['kick_evidence'])
    weights[base:] = np.exp(-settings[0]['kick_rarity']) * np.maximum(beyond, 0.0)
    weights[base] = 0.0
    weights /= weights.sum()


def mixture(filters: Records, count: int) -> tuple[float, float, float, float, float]:
    states, covariances = taken(filters[:count])
    weights = filters['weight'][:count] / filters['weight'][:count].sum()
    mean = weights @ states
    apart = states - mean
    of_each = covariances + apart[:, :, None] * apart[:, None, :]
    whole = np.tensordot(weights, of_each, 1)
    return float(mean[0]), float(mean[1]), *(float(whole[n]) for n in ((0, 0), (0, 1), (1, 1)))


def suppose_kick(
    filters: Records, base: int, older: int, elapsed: float, least_kick: float
) -> None:
    likeliest = filters[int(filters['weight'][:base].argmax())]
    for name in (*STATE, *COVARIANCE, 'bias_variance', 'odds'):
        row = filters[name]
        row[base + 1 : base + 1 + older] = row[base : base + older].copy()
        row[base] = likeliest[name] if name != 'odds' else 0.0
    kick = float(filters['rate'][base]) ** 2 + least_kick
    filters['arc_arc'][base] += kick * elapsed**2 / 4
    filters['rate_rate'][base] += kick


def begin_steady(filters: Records, base: int) -> None:
    filters['weight'][0], filters['weight'][1:base] = 0.0, filters['share'][1:base]
    arc, rate, of_arc, both, of_rate = mixture(filters, base)
    shares = filters['weight'][1:base]
    covariance = np.zeros((1, 4, 4))
    covariance[0, :2, :2] = [[of_arc, both], [both, of_rate]]
    covariance[0, 3, 3] = shares @ filters['disturbance_disturbance'][1:base]
    disturbance = float(shares @ filters['disturbance'][1:base])
    put(filters[:1], np.array([[arc, rate, 0.0, disturbance]]), covariance)


def begin_kicked(filters: Records, base: int) -> None:
    states, covariances = taken(filters)
    likeliest = base + int(filters['odds'][base:].argmax())
    kept = np.array([1.0, 1.0, 0.0, 1.0])
    all_alike = np.tile(kept * states[likeliest], (base, 1))
    spread = np.tile(kept[:, None] * covariances[likeliest] * kept, (base, 1, 1))
    spread[:, 2, 2] = filters['bias_variance'][:base]
    put(filters[:base], all_alike, spread)
    filters['odds'][base:] = -math.inf


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
    given = {name: float(settings[name][0]) for name in settings.dtype.names or ()}
    more, most = update(filters, base, arc, variance, degrees_of_freedom)
    least = given['least_odds_at_edges' if at_edge else 'least_odds'] * calm
    against = max(against + more, least)
    if against >= given['odds_of_doubt']:
        begin_steady(filters, base)
        against = given['odds_begun_anew']
    if most > given['kick_beyond_chance']:
        begin_kicked(filters, base)
        against, frames = max(against, given['odds_begun_anew']), 0
    frames += 1
    halves = next(k for k in range(64) if frames % 2 ** (k + 1))
    set_weights(filters, settings, base, against)
    suppose_kick(filters, base, min(halves, len(filters) - base - 1), elapsed, least_kick)
    return (against, frames), mixture(filters, len(filters))


def add_residuals(encoders: Records, residuals: Array, sides: Array, variance: float) -> None:
    for name, side in (('before', 1), ('beyond', -1)):
        known = (sides == side) & np.isfinite(residuals)
        encoders['means'][known] += 1
        encoders[f'weight_{name}'][known] += 1 / variance
        encoders[f'sum_{name}'][known] += residuals[known] / variance


def solve(encoders: Records, of_offsets: float, of_rest_angles: float) -> None:
    for each in encoders:
        before, beyond = each['weight_before'], each['weight_beyond']
        matrix = np.array([[1, 1], [1, -1]]).T @ np.diag([before, beyond]) @ [[1, 1], [1, -1]]
        covariance = np.linalg.inv(matrix + np.diag([of_offsets, of_rest_angles]))
        right = each['sum_before'] + each['sum_beyond'], each['sum_before'] - each['sum_beyond']
        each['offset'], each['rest_angle'] = covariance @ right
        each['offset_offset'], each['offset_rest_angle'] = covariance[0]
        each['rest_angle_rest_angle'] = covariance[1, 1]


def find_sure(
    encoders: Records, settings: Records, repeated: float, deviations: Array, corrections: Array
) -> None:
    deviations[:] = np.sqrt(encoders['offset_offset'] + repeated)
    sure = np.abs(encoders['offset']) > settings[0]['significance'] * deviations
    sure &= encoders['means'] >= settings[0]['fewest_means']
    corrections[:] = np.where(sure, encoders['offset'], 0.0)


def compare_means(
    encoders: Records,
    sums: Array,
    corrections: Array,
    share: float,
    before: float,
    beyond: float,
    sides: Array,
    found: Array,
) -> tuple[int, int]:
    rotors = np.arange(len(sums))
    sides[:] = np.where(rotors < before, 1.0, np.where(rotors > beyond, -1.0, 0.0))
    expected, variances = expected_residuals(encoders, sides)
    found[0] = share * sums + corrections
    found[1] = np.where(sides == 0, np.nan, found[0] - expected)
    found[2] = np.sqrt(variances)
    known = np.isfinite(found[1])
    passed = (encoders['weight_before'] > 0) & (encoders['weight_beyond'] > 0)
    counts = int(np.count_nonzero(known)), int(np.count_nonzero(passed))
    found[3, : counts[0]] = found[1, known] ** 2
    found[4, : counts[0]] = np.maximum(np.abs(found[1, known]) - found[2, known], 0.0)
    found[5, : counts[1]] = np.abs(encoders['offset'][passed])
    return counts


def beyond_chance(
    encoders: Records, settings: Records, sides: Array, repeated: float, apart: Array
) -> None:
    expected, variances = expected_residuals(encoders, sides)
    limits = settings[0]['beyond_chance'] * np.sqrt(variances + repeated)
    apart[:] = np.where(sides == 0, apart, np.maximum(np.abs(expected) - limits, 0))


def find_stuck(
    read: Array, earlier: Array, outlying: Flags, stuck: Flags, few: float, still: float
) -> None:
    same = read == earlier
    if np.count_nonzero(np.abs(read - earlier) <= still) > few * np.count_nonzero(
        np.isfinite(read)
    ):
        same &= outlying | stuck
    earlier[:] = read
    stuck[:] = same


def together(shares: Array, likelihoods: Array) -> float:
    """Logarithm of the mean of likelihoods [logarithm] by their shares."""
    counting, weighed = shares[shares > 0], likelihoods[shares > 0]
    top = float(weighed.max())
    return top + math.log(float(counting @ np.exp(weighed - top)) / float(counting.sum()))


def expected_residuals(encoders: Records, sides: Array) -> tuple[Array, Array]:
    """Residuals o + side * delta that are expected [rad] and their variances, (N,) each."""
    mixed = 2 * encoders['offset_rest_angle'] + sides * encoders['rest_angle_rest_angle']
    expected = encoders['offset'] + sides * encoders['rest_angle']
    return expected, encoders['offset_offset'] + sides * mixed
