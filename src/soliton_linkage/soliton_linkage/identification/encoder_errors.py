# SPDX-License-Identifier: Apache-2.0
"""Score test (Rao, 1948) of two errors of encoders: a wrong gain, and play of the coupling.

A fit assumes that a reading is y = o + phi. An encoder error of the size g adds g s to the
reading. For a wrong gain, the shape s is the angle phi; for play, it is the lag of the encoder
behind the rotor, relative to half of the play. With the normal equations A dp + B g = b of the
unknowns p, and B^T dp + D g = c of the errors, one error has the estimate g with the information
S:

    S = D - B^T A^-1 B,    g = (c - B^T A^-1 b) / S.

Wrong lengths can cause the same residuals as an error of an inner encoder only if the lengths of
neighbouring bonds change together, which the prior makes improbable. Errors of edge encoders are
less certain.
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
"""An error is reported if it is larger than this [standard deviations]; in 20 recordings of 12
rotors with correct encoders, the largest gain error was 2.3, and the largest play 4.0."""
_SMALLEST_ERROR = 0.02
"""Smallest relative error of a gain [1], and smallest play [rad], that are reported. A gain error
of this size changes the estimated lengths by about 1 %."""
_HALF_PLAY = 0.05
"""Half of the play for which the shape of the lag is computed [rad]. An actual half play of 0.05
rad was estimated as 0.05 rad, and one of 0.1 rad as 0.07 to 0.11 rad."""


def error_shapes(angles: Array) -> Array:
    """Return the shapes of the gain and of the play, (2, T, N), for angles [rad], (T, N).

    An encoder with play keeps its angle until the rotor has moved by the play. Its shape is
    therefore -1 while the rotor turns forwards, and 1 while it turns backwards.
    """
    lags = np.zeros_like(angles)
    for frame in range(1, len(angles)):
        kept = angles[frame - 1] + lags[frame - 1] - angles[frame]
        lags[frame] = np.clip(kept, -_HALF_PLAY, _HALF_PLAY)
    return np.stack([angles, lags / _HALF_PLAY])


def bar_scores(readings: Readings, found: Adjustment, noise: float) -> tuple[Array, Array]:
    """Return the result of `error_scores` for a fit of bars; `noise` is the reading noise."""
    data = readings.unwrapped, readings.relative_deviations, repeat_counts(readings.unwrapped)
    bundle = Bundle(found.lengths, *data).closed(found.lengths)
    shapes = error_shapes(bundle.angles.T).transpose(0, 2, 1)
    matrix, vector = (each / noise**2 for each in bundle.error_equations(shapes))
    prior = found.tolerances.information(found.lengths.rotors)
    return error_scores(
        matrix, vector, prior, to_unknowns(found.lengths), observable_basis(found.lengths)
    )


def error_scores(
    matrix: Array, vector: Array, prior: Array, unknowns: Array, basis: Array
) -> tuple[Array, Array]:
    """Return the scores c - B^T A^-1 b of E errors, (E,), and the matrix S, (E, E).

    `matrix`, (P + E, P + E), and `vector`, (P + E,), are the normal equations of P unknowns and E
    errors without the prior. `prior` is the information of the prior on the `unknowns`, (P,),
    whose prior mean is 0. The unknowns change only along the columns of `basis`.
    """
    size = len(unknowns)
    own = basis.T @ (matrix[:size, :size] + prior) @ basis
    coupling = basis.T @ matrix[:size, size:]
    solved = np.linalg.solve(own, coupling)
    right = basis.T @ (vector[:size] - prior @ unknowns)
    return vector[size:] - solved.T @ right, matrix[size:, size:] - coupling.T @ solved


def encoder_fault(joints: Sequence[str], scores: Array, information: Array) -> str:
    """Return a text about the most significant error of the encoders, or '' if there is none.

    `scores` and `information` are the results of `error_scores` for the shapes of `error_shapes`.
    The common gain of all encoders is tested, too.
    """
    rotors = len(joints)
    gains, all_gains = scores[:rotors], information[:rotors, :rotors]
    candidates = [
        ('each rotor', False, gains.sum(), all_gains.sum()),
        *zip(joints, [False] * rotors, gains, np.diag(all_gains), strict=True),
        *zip(
            joints,
            [True] * rotors,
            np.maximum(scores[rotors:], 0.0),
            np.diag(information)[rotors:],
            strict=True,
        ),
    ]
    whose, is_play, score, certain = max(candidates, key=lambda one: one[2] ** 2 / one[3])
    size, significance = score / certain, abs(score) / math.sqrt(certain)
    if significance < _SIGNIFICANT or abs(size) * (1 + is_play) < _SMALLEST_ERROR:
        return ''
    certainty = f'({significance:.2g} standard deviations)'
    if is_play:
        return (
            f'{whose} has an encoder with a play of about {2 * size:.2g} rad {certainty}: fasten '
            'its coupling, and record again'
        )
    return (
        f'{whose} has a wrong gain, its readings are about {abs(size):.1%} too '
        f'{"large" if size > 0 else "small"} {certainty}: correct the counts per turn, or divide '
        f'the readings by {1 + size:.3f}'
    )
