# SPDX-License-Identifier: Apache-2.0
"""Checks of the order and the mounting of encoders, from the angles of neighbouring rotors.

The angles of two neighbours follow Freudenstein's equation of four-bar linkages. With the spacing
a, the rotor lengths r_1 and r_2, and the bond length l,

    cos(phi_1 - phi_2) = K_0 + K_1 sin(phi_2) - K_2 sin(phi_1),
    K_0 = (a^2 + r_1^2 + r_2^2 - l^2) / (2 r_1 r_2),    K_1 = a / r_1,    K_2 = a / r_2.

An error of half a turn of phi_2 changes the signs of K_0 and K_2. If the sign of a reading is
reversed, or if the rotors are not neighbours, then either no curve of this form fits the angles,
or the fitted bond has lengths with which no wall can pass it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

_LARGEST_MISFIT = 0.04
"""A fitted curve does not match the readings if its misfit is larger than this [rad]."""
_LEAST_SWING = 0.15
"""A wall counts as having passed a rotor if the range of sin(phi), relative to the median range of
all rotors, is larger than this [1]."""
_QUANTILES = 0.02, 0.98
"""The difference between these two quantiles of sin(phi) is used as the range of sin(phi) [1]."""
_WEIGHTINGS = 4
"""Number of successive fits of a curve [1]; each fit uses weights from the previous one."""
_FLATTEST = 0.1
"""The weight of a frame in the fit of a curve is 1 / sqrt(d^2 + this^2) [1]. Here d is the norm of
the derivatives, by the two angles, of the difference between the two sides of Freudenstein's
equation. Without this term, frames with d near 0 would dominate."""
_BETTER = 0.8
"""The sign of an encoder counts as reversed if the misfit with the opposite sign is less than this
times the misfit with the recorded sign [1]."""
_AS_GOOD = 1.25
"""This limit replaces `_BETTER` if a wall can pass the bond only with the opposite sign [1]."""
_IMPASSABLE = 0.95
"""A bond is assumed to stop walls if its squared length, divided by the smallest squared length
that lets a wall pass, is below this [1]. The exact limit is 1, but noise changes the ratio by
0.03."""
NO_JOINT = 'the recording has no joint'
MOST_NAMED = 4
"""Largest number of joints, or of possible causes, that a message names [1]."""
_MOST_WRONG = 1 / 4
"""Wrong mountings are reported only if they concern at most this fraction of the rotors [1]."""


class NotNeighboursError(ValueError):
    """Error for successive joints that do not belong to neighbouring rotors."""


class Mounting(NamedTuple):
    """Faults of an encoder, or of the second encoder of a pair relative to the first one."""

    reversed: bool = False
    turned: bool = False
    """Whether the zero of the encoder has an error of half a turn."""

    @property
    def remedy(self) -> str:
        """Formula that converts a reading phi to the correct angle."""
        return {(False, True): 'phi - pi', (True, False): '-phi', (True, True): 'pi - phi'}.get(
            self, 'phi'
        )


class _Curve(NamedTuple):
    mounting: Mounting
    misfit: float
    room: float
    """Squared length of the fitted bond, divided by the smallest one that lets a wall pass [1]."""
    backward: bool
    """Whether K_1 and K_2 are negative: joints are exchanged, or both have half-turn errors."""

    @property
    def strange(self) -> bool:
        return self.room < _IMPASSABLE and self.misfit > _LARGEST_MISFIT

    @property
    def unlike_neighbours(self) -> bool:
        return self.strange or any(self.mounting)


def check_mounting(readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError for exchanged joints, wrong signs or half-turn errors in `readings`."""
    curves = _curves(readings)
    backward = [n for n, curve in enumerate(curves) if curve.backward]
    if 0 < len(backward) < len(curves) / 2:
        first = last = backward[0]
        while last + 1 in backward:
            last += 1
        pair = [first, last + 1]
        ordered = readings.copy()
        ordered[:, pair] = readings[:, pair[::-1]]
        adjacent = last - first < 2
        if adjacent and not _is_better(_curves(ordered), curves):
            return
        raise ValueError(
            'the joints are not in the order of the rotors: '
            f'{names[last + 1]} is before {names[first]}; '
            + ('swap them' if adjacent else 'name them from the first rotor to the last')
        )
    wrong = _wrong_rotors(curves)
    inner = curves[1:-1]
    if (
        not wrong
        or any(curve.strange for curve in curves)
        or any(any(curve.mounting) and curve.misfit > _LARGEST_MISFIT for curve in inner)
        or not _isolated(sorted(wrong), readings.shape[1])
    ):
        return
    faults = []
    for rotor, mounting in wrong.items():
        how = 'is mounted backwards' if mounting.reversed else 'has an error of half a turn'
        faults.append(f'{names[rotor]} {how}: publish {mounting.remedy} for it')
    rotor, last = min(wrong), readings.shape[1] - 1
    hint = ''
    if rotor in (0, last) and wrong[rotor] == Mounting(True, True):
        beside = names[1 if rotor == 0 else last - 1]
        hint = f', unless a rotor between it and {beside} is missing; then record all rotors'
    raise ValueError(f'{"; ".join(faults)}{hint}')


def zeros_explain(readings: Array, errors: Array) -> bool:
    """Return whether zero errors [rad], (N,), explain why pairs do not move like neighbours.

    Each such pair must have an error, and a correction of the errors must reduce the misfits of
    the fitted curves. If a rotor is missing between two joints, the correction increases the
    misfits.
    """
    curves, corrected = _curves(readings), _curves(readings - errors)
    wrong = errors != 0
    explained = wrong[:-1] | wrong[1:]
    return all(
        done or not curve.unlike_neighbours for done, curve in zip(explained, curves, strict=True)
    ) and _is_better(corrected, curves)


def _is_better(some: Sequence[_Curve], others: Sequence[_Curve]) -> bool:
    return sum(each.misfit**2 for each in some) < sum(each.misfit**2 for each in others)


def check_neighbours(readings: Array, names: Sequence[str]) -> None:
    """Raise NotNeighboursError if successive joints do not belong to neighbouring rotors."""
    curves = _curves(readings)
    strange = [n for n, curve in enumerate(curves) if curve.unlike_neighbours]
    if strange:
        n = strange[0]
        more = f' and {len(strange) - 1} more pairs' if len(strange) > 1 else ''
        raise NotNeighboursError(
            f'{names[n]} and {names[n + 1]}{more} do not move like neighbours: rotors between '
            'them are missing, joints are not in the order of the rotors, or an encoder has a '
            'wrong zero or gain; record all rotors, name them from the first to the last, and '
            'check the encoders'
        )


def absent_joints(names: Sequence[str]) -> str:
    """Return a text that lists the numbers absent from joint names, or '' if there are none.

    If the first number is 1, the text only mentions that a joint 0 may be absent, because joints
    may be numbered from 1.
    """
    found = [re.fullmatch(r'(.*?)(\d+)', name) for name in names]
    parts = [(each[1], int(each[2])) for each in found if each]
    numbers = {number for _, number in parts}
    if len(parts) < len(names) or len({prefix for prefix, _ in parts}) > 1:
        return ''
    absent = sorted(set(range(min(numbers), max(numbers))) - numbers)
    prefix, first = parts[0][0], min(numbers)
    texts = []
    if absent:
        named = listed([f'{prefix}{number}' for number in absent])
        texts.append(f'{NO_JOINT} {named}; record all rotors, or number the joints without gaps')
    if first:
        texts.append(
            f'the first joint is {prefix}{first}; if the chain has a rotor before it, record all '
            'rotors'
        )
    return '; '.join(texts)


def listed(names: Sequence[str]) -> str:
    """Return the first names, and the number of the others."""
    more = f' and {len(names) - MOST_NAMED} more' if len(names) > MOST_NAMED else ''
    return f'{", ".join(names[:MOST_NAMED])}{more}'


def _isolated(rotors: list[int], count: int) -> bool:
    return len(rotors) <= _MOST_WRONG * count and bool((np.diff(rotors) > 1).all())


def _wrong_rotors(curves: Sequence[_Curve]) -> dict[int, Mounting]:
    states = [Mounting()]
    for curve in curves:
        relative = zip(states[-1], curve.mounting, strict=True)
        states.append(Mounting(*(one != other for one, other in relative)))
    usual = max(states, key=states.count)
    relative_states = (
        Mounting(*(one != other for one, other in zip(state, usual, strict=True)))
        for state in states
    )
    return {rotor: state for rotor, state in enumerate(relative_states) if any(state)}


def _curves(readings: Array) -> list[_Curve]:
    low, high = np.quantile(np.sin(readings), _QUANTILES, axis=0)
    swings = high - low > _LEAST_SWING * np.median(high - low)
    return [
        _curve(readings[:, n], readings[:, n + 1])
        if swings[n] and swings[n + 1]
        else _Curve(Mounting(), 0.0, 1.0, False)
        for n in range(readings.shape[1] - 1)
    ]


def _curve(first: Array, second: Array) -> _Curve:
    plain = _fitted(first, second, False)
    other = _fitted(first, -second, True)
    passable = other.room > _IMPASSABLE
    better = passable and other.misfit < _BETTER * plain.misfit
    possible = plain.room < _IMPASSABLE < other.room and other.misfit < _AS_GOOD * plain.misfit
    return other if better or possible else plain


def _fitted(first: Array, second: Array, is_reversed: bool) -> _Curve:
    terms = np.stack([np.ones_like(first), np.sin(second), -np.sin(first)], axis=1)
    cosines, sines = np.cos(first - second), np.sin(first - second)
    weights: NDArray[np.float64] = np.ones_like(first)
    for _ in range(_WEIGHTINGS):
        factors = np.linalg.lstsq(terms * weights[:, None], cosines * weights, rcond=None)[0]
        by_first = factors[2] * np.cos(first) - sines
        by_second = sines - factors[1] * np.cos(second)
        weights = 1 / np.sqrt(by_first**2 + by_second**2 + _FLATTEST**2)
    misfit = float(np.sqrt(np.mean(((cosines - terms @ factors) * weights) ** 2)))
    constant, left, right = factors.tolist()
    turned = left * right < 0
    # Lengths in units of the spacing.
    r1, r2 = 1 / max(abs(left), 1e-9), 1 / max(abs(right), 1e-9)
    squared = 1 + r1**2 + r2**2 - 2 * r1 * r2 * (-constant if turned else constant)
    room = squared / (1 + abs(r1 - r2)) ** 2
    backward = not is_reversed and left < 0 and right < 0
    return _Curve(Mounting(is_reversed, turned), misfit, room, backward)


_CHECKED_FRAMES = 9
"""Approximate number of frames in which the unit of the angles is checked [1]."""
_SMALLEST_IN_DEGREES = 4.0
"""The angles of a frame count as degrees only if the absolute value of at least one of them is
larger than this. In degrees, phi_n + phi_{n+1} is near 180, so that one of the two is about 90 or
more."""
_LARGEST_STAGGER = 0.2
"""Angles are consistent with a chain if the median of 1 + cos(phi_n + phi_{n+1}) over a frame is
smaller than this [1]. If degrees are used as radians, the median is about 0.4."""


def check_unit(readings: Array) -> None:
    """Raise ValueError if most of the checked frames of `readings`, (T, N), are in degrees."""
    some = readings[:: max(1, len(readings) // _CHECKED_FRAMES)]
    if np.mean([in_degrees(frame) for frame in some]) > 0.5:
        raise ValueError('the angles look like degrees; publish radians')


def in_degrees(angles: Array) -> bool:
    """Return whether angles are in degrees, with phi_n + phi_{n+1} near 180 degrees."""
    largest = np.nanmax(np.abs(angles), initial=0.0)
    return bool(
        np.isfinite(largest)
        and largest > _SMALLEST_IN_DEGREES
        and _stagger(np.deg2rad(angles)) < min(_stagger(angles), _LARGEST_STAGGER)
    )


def in_radians(angles: Array, frame: Array) -> Array:
    """Return angles in radians; they are in degrees if the readings of a frame, (N,), are."""
    return np.deg2rad(angles) if in_degrees(frame) else angles


def _stagger(angles: Array) -> float:
    misfits = 1 + np.cos(angles[:-1] + angles[1:])
    seen = misfits[np.isfinite(misfits)]
    return float(np.median(seen)) if len(seen) else np.nan
