# SPDX-License-Identifier: Apache-2.0
"""Score test (Rao, 1948) for errors of encoders: a wrong gain, play, and nonlinearity.

A fit assumes that a reading is y = o + phi. An encoder error of size g adds g s to the reading,
where the shape s is a function of time that depends on the kind of error. For the gain, s is the
angle phi. For play of the coupling, g is half of the play; s is -1 while the rotor turns forwards,
because the encoder then lags behind, and 1 while it turns backwards. If the coupling slips once
while the rotor turns, the reading changes by a step. Play has nearly the same shape, because s
changes by a step when the rotor begins to turn in the other direction. Nonlinearity, for example
of an encoder disc that is not centred on the axis, is described by sin(phi), cos(phi), sin(2 phi)
and cos(2 phi), together with the gain.

If the normal equations of the unknowns p are A dp + B g = b, and the normal equations of the
errors are B^T dp + D g = c, then the estimated errors g and their information S are

    S = D - B^T A^-1 B,    g = S^-1 (c - B^T A^-1 b).

If the fit includes the errors, the sum of squared residuals, divided by the variance of a reading,
decreases by g^T S g. The square root of this decrease is the significance of the errors in
standard deviations.

Wrong lengths imitate an encoder error of an inner rotor only if the lengths of both of its bonds
are wrong in the same way. The prior of the lengths makes this improbable. An edge rotor has only
one bond, so its encoder errors are less certain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, observable_basis
from soliton_linkage.identification.bundle import Bundle
from soliton_linkage.identification.lengths import to_unknowns
from soliton_linkage.identification.readings import Readings, repeat_counts
from soliton_linkage.linkage.chain import Array

_SIGNIFICANT = 4.5
"""An error of an encoder is certain if it is larger than this [standard deviations]. In 20 correct
recordings of 12 rotors, the largest gain error was 2.3 and the largest play 4.0."""
_SUSPICIOUS = 3.0
"""A gain error between this and `_SIGNIFICANT` is reported as possible [standard deviations]. This
limit is low, because gains of edge rotors may have standard deviations of about 2 %."""
_SIGNIFICANT_NONLINEARITY = 9.0
"""Nonlinearity is reported only if its significance is larger than this [standard deviations]."""
_NONLINEAR = 1.3
"""Nonlinearity is reported, and not a wrong gain, if it decreases the sum of squares by more than
this times the decrease by the gain alone [1]; with wrong gains, this ratio was at most 1.08."""
_SIMILAR = 0.85
"""Besides the most probable rotor, other rotors are named if an error of their encoder decreases
the sum of squares by more than this times the largest decrease [1]. Such an error explains the
recording nearly as well."""
_SMALLEST_ERROR = 0.02
"""Smallest relative error of a gain [1], and smallest play [rad], that are reported. A gain error
of this size changes lengths by about 1 %."""
_HALF_PLAY = 0.05
"""Half of the play that `error_shapes` assumes [rad]. With this value, half plays of 0.05 rad were
estimated as 0.05 rad, and half plays of 0.1 rad as 0.07 to 0.11 rad."""
_SHOWN = 0.1
"""A fit of rigid bars confirms an encoder error that a fit of springs shows if errors of the same
encoder decrease its sum of squares by more than this times the decrease in the fit of springs [1].
For wrong gains of 12 chains, this ratio was 0.17 to 8. It was at most 0.09 for the gains by which
fits of springs explained an unrecorded force: that of a rotor missing before the first or after
the last joint, or three pulls by a hand."""
_LARGEST_NONLINEARITY = 0.3
"""Prior standard deviation of the amplitudes of a nonlinearity [rad]. It matters only for rotors
that turn little, whose amplitudes are not observable."""


def error_shapes(angles: Array) -> Array:
    """Return the shapes of gain, play and nonlinearity, (6, T, N), for angles [rad], (T, N).

    After each reversal of its rotor, an encoder with play keeps its angle until the rotor has
    moved by the play. The shape of play is the angle of the encoder minus the angle of the rotor,
    divided by half of the play. It is -1 while the rotor turns forwards, and 1 while the rotor
    turns backwards.
    """
    lags = np.zeros_like(angles)
    for frame in range(1, len(angles)):
        kept = angles[frame - 1] + lags[frame - 1] - angles[frame]
        lags[frame] = np.clip(kept, -_HALF_PLAY, _HALF_PLAY)
    waves = [wave(k * angles) for k in (1, 2) for wave in (np.sin, np.cos)]
    return np.stack([angles, lags / _HALF_PLAY, *waves])


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
    errors without the prior. `prior`, (P, P), is the information matrix of the prior of the
    `unknowns`, (P,); the prior mean is 0. The unknowns change only along the columns of `basis`.
    """
    size = len(unknowns)
    own = basis.T @ (matrix[:size, :size] + prior) @ basis
    coupling = basis.T @ matrix[:size, size:]
    solved = np.linalg.solve(own, coupling)
    right = basis.T @ (vector[:size] - prior @ unknowns)
    return vector[size:] - solved.T @ right, matrix[size:, size:] - coupling.T @ solved


class EncoderFault(NamedTuple):
    """Encoder error that the readings show."""

    text: str
    decrease: float
    """Decrease of the sum of squared residuals if the fit includes the error, divided by the
    variance of a reading [1]."""
    rotor: int | None = None
    """Number of the rotor whose encoder most likely has the error; None for all rotors."""
    force: bool = False
    """Whether `text` names an unrecorded force as another cause."""

    @property
    def certain(self) -> bool:
        """Whether the error exceeds `_SIGNIFICANT`, so that noise is an unlikely cause."""
        return self.decrease > _SIGNIFICANT**2

    def or_force(self, joints: Sequence[str], likelier: bool) -> EncoderFault:
        """Return the error; its text also names an unrecorded force, first if `likelier`."""
        if self.force:
            return self
        force = unrecorded_force(joints)
        causes = (force, self.text) if likelier else (self.text, force)
        return self._replace(text='; or '.join(causes), force=True)


def unrecorded_force(joints: Sequence[str]) -> str:
    """Return a text that names an unrecorded force as a cause."""
    return (
        'a force that was not recorded acts: a hand, or a rotor that is missing before '
        f'{joints[0]} or after {joints[-1]}'
    )


def encoder_fault(joints: Sequence[str], scores: Array, information: Array) -> EncoderFault | None:
    """Return the most significant error of the encoders; None if no error exceeds its limit.

    `scores` and `information` are the results of `error_scores` for the shapes of `error_shapes`.
    A gain error that all encoders have in common is also tested.
    """
    rotors = len(joints)
    gains, certain = scores[:rotors], np.diag(information)
    plays = np.maximum(scores[rotors : 2 * rotors], 0.0)
    of_gain, of_play = (
        np.where(each**2 > limit**2 * weight, each**2 / weight, 0.0)
        * (size * np.abs(each) > _SMALLEST_ERROR * weight)
        for each, weight, size, limit in (
            (gains, certain[:rotors], 1, _SUSPICIOUS),
            (plays, certain[rotors : 2 * rotors], 2, _SIGNIFICANT),
        )
    )
    of_waves = np.array([_decrease(scores, information, n, rotors) for n in range(rotors)])
    limits = np.maximum(_SIGNIFICANT_NONLINEARITY**2, _NONLINEAR * gains**2 / certain[:rotors])
    of_waves[of_waves < limits] = 0.0
    decreases = np.max([of_gain, of_play, of_waves], axis=0)
    common, weight = float(gains.sum()), float(information[:rotors, :rotors].sum())
    size = common / weight
    if common**2 / weight > max(_SIGNIFICANT**2, decreases.max()) and abs(size) > _SMALLEST_ERROR:
        return EncoderFault(_gain_error('each rotor', size, common**2 / weight), common * size)
    if not decreases.max() > 0:
        return None
    order = np.argsort(-decreases)
    worst = int(order[0])
    largest = float(decreases[worst])
    named = [joints[n] for n in order if decreases[n] > _SIMILAR * largest]
    whose = ' or '.join(named)
    if of_play[worst] == largest:
        play = 2 * plays[worst] / certain[rotors + worst]
        text = (
            f'{whose} has an encoder with a play of about {play:.2g} rad, or one that slips '
            f'{_certainty(largest)}: fasten its coupling, and record again'
        )
    elif of_gain[worst] == largest:
        text = _gain_error(whose, float(gains[worst] / certain[worst]), largest)
        # If a rotor turns only once, a slip during the turn has the same shape.
        text += '; or the encoder slips while the rotor turns: fasten it'
    else:
        text = (
            f'{whose} has an encoder whose error depends on the angle, or one that slips '
            f'{_certainty(largest)}: check its coupling, its counts per turn and the centring of '
            'its disc or magnet, or calibrate it'
        )
    fault = EncoderFault(text, largest, worst)
    if of_waves[worst] == largest and worst in (0, rotors - 1):
        # An edge rotor has one neighbour, so that bars show a nonlinearity of it only weakly.
        return fault.or_force(joints, likelier=True)
    return fault


def shown_by_bars(
    fault: EncoderFault, joints: Sequence[str], scores: Array, information: Array
) -> EncoderFault:
    """Return `fault`, with a more likely cause in its text if a fit of bars does not confirm it.

    `fault` is an encoder error that a fit of springs shows. `scores` and `information` are the
    results of `bar_scores`. An encoder error causes misclosures of the bonds, so that a fit of
    bars also shows it. A force on a rotor changes only the motion. Therefore, an unrecorded force
    is the more likely cause of an error that only the fit of springs shows.
    """
    if fault.rotor is None:
        return fault
    rotors, rotor = len(joints), fault.rotor
    play = float(scores[rotors + rotor] ** 2 / information[rotors + rotor, rotors + rotor])
    if max(play, _decrease(scores, information, rotor, rotors)) > _SHOWN * fault.decrease:
        return fault
    return fault.or_force(joints, likelier=True)


def _decrease(scores: Array, information: Array, rotor: int, rotors: int) -> float:
    every = np.arange(rotor, len(scores), rotors)
    some = np.delete(every, 1)
    prior = np.eye(len(some)) / _LARGEST_NONLINEARITY**2
    matrix = information[np.ix_(some, some)] + prior
    return float(scores[some] @ np.linalg.solve(matrix, scores[some]))


def _gain_error(whose: str, size: float, decrease: float) -> str:
    return (
        f'{whose} has a wrong gain, its readings are about {abs(size):.1%} too '
        f'{"large" if size > 0 else "small"} {_certainty(decrease)}: correct the counts per turn, '
        f'or divide the readings by {1 + size:.3f}'
    )


def _certainty(decrease: float) -> str:
    return f'({math.sqrt(decrease):.2g} standard deviations)'
