# SPDX-License-Identifier: Apache-2.0
"""From a recording in which a soliton has passed to a chain with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, adjusted
from soliton_linkage.identification.bar_motion import BarMotion, bar_motion
from soliton_linkage.identification.free_motion import FreeMotion
from soliton_linkage.identification.identification import (
    STRAINED,
    Identification,
    of_bonds,
    of_springs,
)
from soliton_linkage.identification.lengths import equal_rotors
from soliton_linkage.identification.mass_scale import mass_scale
from soliton_linkage.identification.motion_fit import MotionFit, MotionFitting
from soliton_linkage.identification.readings import Readings, informative_frames
from soliton_linkage.identification.screening import (
    LEAST_NOISE,
    check_jumps,
    check_motion,
    check_slips,
    noise_of,
)
from soliton_linkage.identification.windows import first_windows
from soliton_linkage.linkage.chain import Array, Chain

_NOT_CLOSED = (
    'no lengths close the bonds of this recording; check the order of the joints, their signs and '
    'their zeros, and that no rotor was held'
)
_MOST_FITTED = 3000
"""Frames of which a free motion is fitted [1], those that tell most: 40 rotors take a minute or
two."""


def identify(
    readings: Readings,
    given: Chain,
    tolerance: float | None = None,
    spacing_known: bool = True,
) -> Identification:
    """Chain that readings show.

    The given chain tells what angles do not: the mean spacing, which gravity tells where it is
    not known, masses, stiffness and damping; its number of rotors and other lengths do not
    count. A tolerance of lengths [1] is learnt unless it is given. Raises ValueError, in one
    line, for a recording that shows no chain.
    """
    times, whole = readings.times, readings.whole
    _check_passage(readings.recordings)
    noise = noise_of(readings.seen, readings.spreads)
    for recording in readings.recordings:
        check_jumps(recording, noise)
    try:
        found = adjusted(readings.seen, equal_rotors(whole), tolerance, readings.spreads)
    except np.linalg.LinAlgError as error:
        raise ValueError(_NOT_CLOSED) from error
    known = spacing_known or not readings.gravity.acceleration
    pushes = [push.time for push in readings.impulses]
    stay = informative_frames(times, readings.seen, pushes, _MOST_FITTED)
    left_out = len(times) - len(stay)
    some = replace(readings, angles=readings.seen).of_frames(stay)
    fitted = _fitted(some, found.left[stay], found, given, noise, tolerance, known)
    if fitted is not None:
        check_slips(some, fitted.left, fitted.noise)
        given = _scaled(given, readings, fitted.motion.gravity)
        scale = mass_scale(fitted, some, given.spacing)
        return of_springs(fitted, given, noise, scale, left_out)
    check_slips(readings, found.left / readings.spreads, max(noise, found.noise))
    if not found.settled:
        raise ValueError(_NOT_CLOSED)
    if found.noise > STRAINED * noise:
        return of_bonds(found, given, noise)
    moved = _bars_moved(some, found, given, known)
    if moved is None:
        return of_bonds(found, given, noise)
    return of_bonds(found, _scaled(given, readings, moved.gravity), noise, moved, left_out)


def _check_passage(recordings: Sequence[Readings]) -> None:
    """Raise ValueError unless a wall passes all rotors in one of the recordings."""
    complaints = []
    for each in recordings:
        try:
            check_motion(each.times, each.whole, each.joints)
        except ValueError as error:
            complaints.append(error)
        else:
            return
    raise complaints[0]


def _scaled(given: Chain, readings: Readings, gravity: float) -> Chain:
    """Given chain with the mean spacing in which gravity is as it was found [1/s^2]."""
    acceleration = readings.gravity.acceleration
    return replace(given, spacing=acceleration / gravity) if acceleration else given


def _fitted(
    some: Readings,
    left: Array,
    found: Adjustment,
    given: Chain,
    noise: float,
    tolerance: float | None,
    spacing_known: bool,
) -> MotionFit | None:
    """Free motion of springs, None where bars explain the readings as well."""
    rotors = found.lengths.rotors
    angles = some.whole - found.lengths.offsets - left
    stiffness = given.stiffness / given.mass
    nothing, alike = np.zeros(rotors), np.ones(rotors)
    start = FreeMotion(
        found.lengths,
        stiffness * alike[1:],
        alike,
        0.0,
        nothing,
        nothing,
        gravity=some.gravity.acceleration / given.spacing,
    )
    windows = first_windows(some.times, angles, start, some.breaks, some.tilt_at)
    if not windows:
        return None
    told = some.times, some.seen, some.spreads, max(noise, LEAST_NOISE)
    try:
        return MotionFitting(windows, *told, tolerance, spacing_known).fit(found.noise)
    except np.linalg.LinAlgError:
        return None


def _bars_moved(
    some: Readings, found: Adjustment, given: Chain, spacing_known: bool
) -> BarMotion | None:
    """What the free motion of bars shows, None where they do not move freely."""
    acceleration = some.gravity.acceleration / given.spacing
    some = replace(some, gravity=replace(some.gravity, acceleration=acceleration))
    noise = max(found.noise, LEAST_NOISE)
    try:
        return bar_motion(some, found.lengths, found.covariance, noise, spacing_known)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
