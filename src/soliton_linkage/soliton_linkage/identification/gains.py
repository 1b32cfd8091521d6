# SPDX-License-Identifier: Apache-2.0
"""Score test (Rao, 1948) of encoder gains: readings that are too large by a constant factor.

A fit assumes that a reading is y = o + phi. With the relative error g of the gain, y = o + (1 + g)
phi. With the normal equations A dp + B g = b of the unknowns p, and B^T dp + D g = c of the gains,
the estimate of one gain has the information S and the value g,

    S = D - B^T A^-1 B,    g = (c - B^T A^-1 b) / S.

The lengths of neighbouring bonds must change together to imitate the gain of an inner rotor, and
the prior of the lengths makes this improbable. The gain of an edge rotor is less certain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, observable_basis
from soliton_linkage.identification.bundle import Bundle
from soliton_linkage.identification.lengths import to_unknowns
from soliton_linkage.identification.readings import Readings, repeat_counts
from soliton_linkage.linkage.chain import Array

_SIGNIFICANT = 4.5
"""A gain error is reported if it is larger than this [standard deviations]; in 36 correct
recordings of 12 rotors, the largest was 2.6."""
_SMALLEST_ERROR = 0.02
"""Smallest relative error of a gain that is reported [1]; it changes lengths by about 1 %."""


def bar_gains(readings: Readings, found: Adjustment, noise: float) -> tuple[Array, Array]:
    """Return the scores c - B^T A^-1 b, (N,), and the matrix S, (N, N), after a fit of bars.

    `noise` is the standard deviation of a reading [rad].
    """
    data = readings.unwrapped, readings.relative_deviations, repeat_counts(readings.unwrapped)
    bundle = Bundle(found.lengths, *data).closed(found.lengths)
    matrix, vector = (each / noise**2 for each in bundle.gain_equations())
    prior = found.tolerances.information(found.lengths.rotors)
    return gain_scores(
        matrix, vector, prior, to_unknowns(found.lengths), observable_basis(found.lengths)
    )


def gain_scores(
    matrix: Array, vector: Array, prior: Array, unknowns: Array, basis: Array
) -> tuple[Array, Array]:
    """Return the scores c - B^T A^-1 b, (N,), and the matrix S, (N, N).

    `matrix`, (P + N, P + N), and `vector`, (P + N,), are the normal equations of P unknowns and N
    gains without the prior. `prior` is the information of the prior on the `unknowns`, (P,), whose
    prior mean is 0. The unknowns change only along the columns of `basis`.
    """
    size = len(unknowns)
    own = basis.T @ (matrix[:size, :size] + prior) @ basis
    coupling = basis.T @ matrix[:size, size:]
    solved = np.linalg.solve(own, coupling)
    right = basis.T @ (vector[:size] - prior @ unknowns)
    return vector[size:] - solved.T @ right, matrix[size:, size:] - coupling.T @ solved


def check_gains(joints: Sequence[str], scores: Array, information: Array) -> None:
    """Raise ValueError if the gain of one encoder, or the common gain of all, has a large error.

    `scores` and `information` are the results of `gain_scores`.
    """
    each = np.diag(information)
    rotor = int(np.argmax(scores**2 / each))
    candidates = [
        (f'the readings of {joints[rotor]}', scores[rotor], each[rotor]),
        ('the readings of all rotors', scores.sum(), information.sum()),
    ]
    whose, score, certainty = max(candidates, key=lambda one: one[1] ** 2 / one[2])
    error, significance = score / certainty, abs(score) / math.sqrt(certainty)
    if abs(error) > _SMALLEST_ERROR and significance > _SIGNIFICANT:
        size = 'large' if error > 0 else 'small'
        raise ValueError(
            f'{whose} are about {abs(error):.1%} too {size} ({significance:.2g} standard '
            f'deviations): correct the counts per turn, or divide the readings by {1 + error:.3f}'
        )
