# SPDX-License-Identifier: Apache-2.0
"""Warnings about an identified chain, and likely causes if no model matches the readings."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from soliton_linkage.identification.adjustment import near_limit_bonds
from soliton_linkage.identification.encoder_errors import EncoderFault, unrecorded_force
from soliton_linkage.identification.lengths import Lengths
from soliton_linkage.identification.motion_fit import UNEXPLAINED
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import find_obstacles

_LARGEST_SPREADS = 0.2, 0.25
"""Largest plausible relative standard deviations [1] of lengths of one kind, for example of all
spacings, and of masses and stiffnesses."""
_USUAL_OF_ROTOR, _USUAL_OF_FRAMES = 1.3, 0.3
"""Usual values of two ratios that rank possible causes [1]. The first ratio, of the mean square
residual of the worst rotor to the mean over all rotors, is larger if one encoder is wrong. The
second ratio, the fraction of the squared residuals that the worst tenth of the frames contains, is
larger if a kick or a hand has acted."""
_FAR_SPACING = 1.5
"""A spacing is reported if it is more than this times the median spacing, or less than the median
spacing divided by this [1]."""
_SCALE_PARTS = {'rotor_length', 'spacing', 'rest_length'}
_MOST_NAMED = 4
"""Largest number of weakly observable combinations that are described one by one [1]."""
_NOT_OBSERVABLE = 1e-4
"""A combination of unknowns with less information than this counts as not observable [1]."""
_WEAK = 0.1
"""A combination of unknowns is reported if the readings alone, without the prior, determine it
with a standard deviation larger than this [1]."""


def unexplained(noise: float, spreads: tuple[float, float]) -> list[str]:
    """Return a text for each value that is too large for a model that explains the readings.

    The values are the `noise` and the two `spreads`; `check_explained` defines them.
    """
    lengths, masses = spreads
    faults = []
    if noise > UNEXPLAINED:
        faults.append(
            f'residuals are {noise:.2g} times the noise of the readings (limit {UNEXPLAINED:g})'
        )
    if lengths > _LARGEST_SPREADS[0]:
        faults.append(
            f'lengths of one kind differ by {lengths:.0%} (limit {_LARGEST_SPREADS[0]:.0%})'
        )
    if masses > _LARGEST_SPREADS[1]:
        faults.append(
            f'masses and stiffnesses differ by {masses:.0%} (limit {_LARGEST_SPREADS[1]:.0%})'
        )
    return faults


def check_explained(
    model: str,
    noise: float,
    spreads: tuple[float, float],
    residuals: Array,
    readings: Readings,
    fault: EncoderFault | None,
) -> None:
    """Raise ValueError with the most likely causes if the model does not explain the readings.

    `model` is 'bars' or 'springs'. Springs are fitted only if the bonds close nearly, so that the
    order of the joints is correct. A force that was not recorded is then the most likely cause,
    because it changes only the motion. `noise` is the root mean square of the `residuals`,
    (T, N), divided by the reading noise [1]. `spreads` contains the estimated relative standard
    deviations [1] of lengths of one kind, and of masses and stiffnesses. `fault` is an encoder
    error, or None. If `fault` is certain, ValueError is raised even if the model explains the
    readings.
    """
    faults = unexplained(noise, spreads)
    if not faults:
        if fault and fault.certain:
            raise ValueError(fault.text)
        return
    by_rotor = np.mean(residuals**2, axis=0)
    by_frame = np.mean(residuals**2, axis=1)
    rotor, frame = int(np.argmax(by_rotor)), int(np.argmax(by_frame))
    of_rotor = float(by_rotor[rotor] / by_rotor.sum())
    few = max(len(by_frame) // 10, 1)
    of_frames = float(np.sort(by_frame)[-few:].sum() / by_frame.sum())
    causes = [
        (
            of_rotor * len(by_rotor) / _USUAL_OF_ROTOR,
            f'{readings.joints[rotor]} ({of_rotor:.0%} of the squared residuals) has a wrong '
            'sign, a wrong zero, or play',
        ),
        (
            of_frames / _USUAL_OF_FRAMES,
            f'a kick or a hand acts near {readings.times[frame] - readings.times[0]:.3g} s (10 % '
            f'of the frames have {of_frames:.0%})',
        ),
    ]
    if model == 'bars':
        causes.append((1.0, 'joints are missing or not in the order of the rotors'))
    elif not (fault and fault.certain and fault.force):
        causes.append((math.inf, unrecorded_force(readings.joints)))
    ordered = [cause for _, cause in sorted(causes, key=lambda each: -each[0])]
    named = '; '.join([fault.text, *ordered] if fault and fault.certain else ordered)
    raise ValueError(
        f'no model explains this recording: with {model}, {" and ".join(faults)}. Most likely '
        f'causes: {named}. Correct them, or select a part of the recording by --begin and --end'
    )


def length_warnings(chain: Chain) -> list[str]:
    """Return a warning for each spacing that differs much from the other spacings."""
    ratios = chain.spacings / np.median(chain.spacings)
    return [
        f'the spacing of bond {bond} is {ratios[bond]:.2g} times the median: a rotor beside it is '
        'missing, or an encoder is wrong; check these rotors'
        for bond in np.flatnonzero(np.abs(np.log(ratios)) > math.log(_FAR_SPACING)).tolist()
    ]


def obstacle_warnings(chain: Chain, lengths: Lengths, covariance: Array) -> list[str]:
    """Return warnings about bonds that may stop walls, and about bonds near one of two limits.

    `lengths` are the lengths of `chain` in units of its mean spacing, and `covariance` is the
    covariance of their unknowns. A bond that violates a limit may stop walls (see
    `solitons.passage`). Any other bond is near a limit if its distance from the limit is smaller
    than three standard deviations of this distance.
    """
    warnings = [
        f'bond {each.bond} may stop a soliton: its spring of {each.rest_length:.4g} m '
        f'{each.reason}'
        for each in find_obstacles(chain)
    ]
    near = near_limit_bonds(lengths, covariance)
    if near:
        bonds = ', '.join(f'{bond} ({chance:.1%})' for bond, chance in near.items())
        warnings.append(
            'these bonds are close to a limit beyond which they may stop walls (in brackets: the '
            f'probability that they are beyond it): {bonds}; record more crossings to reduce the '
            'uncertainty, or adjust these bonds'
        )
    return warnings


def weakly_observable(
    information: Array, basis: Array, split: Callable[[Array], dict[str, Array]]
) -> tuple[str, ...]:
    """Return a text for each combination of unknowns that the readings determine only weakly.

    `information`, (P, P), is the information of the readings about P unknowns, which change only
    along the K columns of `basis`, (P, K). `split` returns a dictionary of the unknowns, with the
    names of their kinds as keys.
    """
    values, vectors = np.linalg.eigh(basis.T @ information @ basis)
    weak = [
        _description(max(float(value), _NOT_OBSERVABLE) ** -0.5, split(basis @ vector))
        for value, vector in zip(values, vectors.T, strict=True)
        if value < _WEAK**-2
    ]
    more = (f'{len(weak) - _MOST_NAMED} more',) if len(weak) > _MOST_NAMED else ()
    return (*weak[:_MOST_NAMED], *more)


def _description(deviation: float, parts: dict[str, Array]) -> str:
    size = max(float(np.abs(part).max()) for part in parts.values())
    kinds = [name for name, part in parts.items() if np.abs(part).max() > 0.5 * size]
    sides = [
        np.concatenate([np.flatnonzero(sign * part > 0.5 * size) for part in parts.values()])
        for sign in (1, -1)
    ]
    large = min((side for side in sides if len(side)), key=np.ptp)
    what = 'scale' if set(kinds) == _SCALE_PARTS else ', '.join(kinds)
    observable = deviation < _NOT_OBSERVABLE**-0.5
    value = f'standard deviation {deviation:.0%}' if observable else 'not observable'
    rotors = f'rotors {large.min()} to {large.max()}' if np.ptp(large) else f'rotor {large[0]}'
    return f'{what} of {rotors} relative to the others: {value}'
