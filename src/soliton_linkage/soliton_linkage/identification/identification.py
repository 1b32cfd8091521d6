# SPDX-License-Identifier: Apache-2.0
"""A chain with standard deviations, from a recording in which a soliton has passed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, adjusted, measurable
from soliton_linkage.identification.bar_motion import BarMotion, bar_motion
from soliton_linkage.identification.free_motion import FreeMotion, split_chain
from soliton_linkage.identification.lengths import OF_A_ROTOR, split, split_lengths
from soliton_linkage.identification.mass_scale import MassScale, mass_scale
from soliton_linkage.identification.motion_fit import MotionFit, MotionFitting
from soliton_linkage.identification.passable import passable
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.residuals import check_jumps, check_slips, noise_of
from soliton_linkage.identification.screening import check_motion
from soliton_linkage.identification.start import equal_rotors
from soliton_linkage.identification.windows import first_windows
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import find_obstacles

_NOT_CLOSED = (
    'no lengths close the bonds of this recording; check the order of the joints, their signs and '
    'their zeros, and that no rotor was held'
)
_NO_FORCES = dict.fromkeys(
    ('damping_deviation', 'friction', 'friction_deviation', 'spacing_deviation'), math.nan
)
"""What is told of a chain that does not move freely."""
_OF_SCALE = {'rotor_length', 'spacing', 'rest_length'}
_MOST_SAID = 4
"""Combinations that are named [1]."""
_LEAST_TOLD = 1e-4
"""Information below which a combination is not told at all [1]: to 100 times its size."""
_OPEN = 0.1
"""Standard deviation of a combination of lengths, by the angles alone, beyond which it is called
open [1]: more than workshops miss."""
_STRAINED = 1.1
"""Noise that is left over that from frame to frame, beyond which it is more than noise [1]."""
_WORSE = 1.25
"""Noise of a bond over that of most, beyond which it is called bad [1]: of 1000 frames chance
makes 1.1."""
_MOST_FITTED = 3000
"""Frames of which a free motion is fitted [1], one in two or more of those that are beyond: 40
rotors take a minute or two."""
_LEAST_NOISE = 1e-4
"""Noise with which a motion is fitted at least [rad]: better encoders are rounded."""


@dataclass(frozen=True)
class Identification:
    """A chain as the angles of a recording show it."""

    chain: Chain
    """With the mean spacing, mass, stiffness and damping that were given."""
    deviations: dict[str, Array]
    """Standard deviation of each length over that length [1], by the names of `Deviations`."""
    offsets: Array
    """What each encoder reads too much [rad], shape (N,)."""
    offset_deviations: Array
    """Standard deviations of these [rad], shape (N,)."""
    noise: float
    """Standard deviation of a reading [rad], as the bonds leave it open."""
    reading_noise: float
    """The same from frame to frame, which knows of no chain."""
    bond_noise: Array
    """The same as `noise` by each bond alone [rad], shape (N - 1,)."""
    tolerance: float
    """Standard deviation by which lengths of one kind differ from each other [1]."""
    damping_deviation: float
    """Standard deviation of the damping [N m s/rad], NaN where it is not told."""
    friction: float
    """Dry friction of each rotor, beside the damping [N m], NaN where it is not told."""
    friction_deviation: float
    """Standard deviation of it [N m]."""
    spacing_deviation: float
    """The same of the logarithm of the mean spacing [1], NaN where gravity did not tell that."""
    mass_deviation: float
    """The same of the logarithm of the mean mass [1], NaN where no push told that."""
    rigid: bool
    """Whether all bonds close to the noise, as bars do: then no stiffness is found."""
    open_combinations: tuple[str, ...]
    """What the angles alone leave open, in words."""
    warnings: tuple[str, ...]
    """What a user must know of it, one line each."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds that leave most open, the worst first."""
        return tuple(np.argsort(-self.bond_noise).tolist())


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
    times, whole, names = readings.times, readings.whole, readings.joints
    _check_passage(readings.recordings)
    noise = noise_of(readings.seen, readings.spreads)
    for recording in readings.recordings:
        check_jumps(recording, noise)
    try:
        found = adjusted(readings.seen, equal_rotors(whole), tolerance, readings.spreads)
    except np.linalg.LinAlgError as error:
        raise ValueError(_NOT_CLOSED) from error
    known = spacing_known or not readings.gravity.acceleration
    fitted = _fitted(readings, found, given, noise, tolerance, known)
    if fitted is not None:
        check_slips(fitted.times, fitted.left, fitted.noise, names)
        given = _scaled(given, readings, fitted.motion.gravity)
        scale = mass_scale(fitted, readings.every(_MOST_FITTED), given.spacing)
        return _of_springs(fitted, given, noise, scale)
    check_slips(times, found.left / readings.spreads, max(noise, found.noise), names)
    if not found.settled:
        raise ValueError(_NOT_CLOSED)
    return _of_bonds(found, readings, given, noise, known)


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
    readings: Readings,
    found: Adjustment,
    given: Chain,
    noise: float,
    tolerance: float | None,
    spacing_known: bool,
) -> MotionFit | None:
    """Free motion of springs, None where bars explain the readings as well."""
    rotors, some = found.lengths.rotors, readings.every(_MOST_FITTED)
    left = found.left[:: math.ceil(len(found.left) / _MOST_FITTED)]
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
        gravity=readings.gravity.acceleration / given.spacing,
    )
    windows = first_windows(some.times, angles, start, some.breaks, some.tilt_at)
    if not windows:
        return None
    told = some.times, some.seen, some.spreads, max(noise, _LEAST_NOISE)
    try:
        return MotionFitting(windows, *told, tolerance, spacing_known).fit(found.noise)
    except np.linalg.LinAlgError:
        return None


def _of_springs(
    fitted: MotionFit, given: Chain, reading_noise: float, scale: MassScale | None
) -> Identification:
    """Chain of springs, whose stiffnesses, masses and damping the motion shows too."""
    motion = fitted.motion
    parts = split_chain(np.sqrt(np.diag(fitted.covariance)))
    geometry = slice(0, OF_A_ROTOR * motion.lengths.rotors - 2)
    lengths = passable(motion.lengths, fitted.covariance[geometry, geometry])
    chain = lengths.scaled(given.spacing).chain(given)
    mass = given.mass if scale is None else scale.mass
    of_mean = mass / float(motion.masses.mean())
    chain = replace(
        chain,
        mass=mass,
        stiffness=of_mean * float(motion.stiffnesses.mean()),
        damping=of_mean * given.spacing**2 * max(motion.damping, 0.0),
        deviations=replace(
            chain.deviations,
            mass=tuple((motion.masses / motion.masses.mean() - 1).tolist()),
            stiffness=tuple((motion.stiffnesses / motion.stiffnesses.mean() - 1).tolist()),
            damping=(),
        ),
    )
    offsets = parts.pop('offset')
    of_drag = of_mean * given.spacing**2
    damping, friction, gravity = (
        float(parts.pop(name)[0]) for name in ('damping', 'friction', 'gravity')
    )
    by_bond = np.sqrt(np.mean(fitted.left**2, axis=0))
    return Identification(
        chain=chain,
        deviations=parts,
        damping_deviation=of_drag * damping,
        friction=of_drag * motion.friction,
        friction_deviation=of_drag * friction,
        spacing_deviation=gravity or math.nan,
        mass_deviation=math.nan if scale is None else scale.deviation,
        offsets=motion.lengths.offsets,
        offset_deviations=offsets,
        noise=fitted.noise,
        reading_noise=reading_noise,
        bond_noise=np.maximum(by_bond[:-1], by_bond[1:]),
        tolerance=fitted.tolerances.of_lengths,
        rigid=False,
        open_combinations=_open_combinations(fitted.information, fitted.basis, split_chain),
        warnings=(*_unexplained(fitted.noise, reading_noise), *_obstacles(chain)),
    )


def _unexplained(noise: float, reading_noise: float) -> tuple[str, ...]:
    if noise <= _STRAINED * max(reading_noise, _LEAST_NOISE):
        return ()
    return (
        f'the motion of springs leaves {noise / reading_noise:.2g} times the noise of the '
        'readings, and standard deviations are too small; record with a slower soliton, or less '
        'of it by --begin and --end',
    )


def _of_bonds(
    found: Adjustment,
    readings: Readings,
    given: Chain,
    reading_noise: float,
    spacing_known: bool,
) -> Identification:
    """Chain whose bonds close, as bars do, or springs about slow walls."""
    rotor, offset, spacing, rest = split(found.deviations)
    deviations = {'rotor_length': rotor, 'spacing': spacing, 'rest_length': rest}
    rigid = found.noise <= _STRAINED * reading_noise
    moved = _bars_moved(found, readings, given, spacing_known) if rigid else None
    forces = _NO_FORCES
    if moved is not None:
        given = _scaled(given, readings, moved.gravity)
    chain = found.lengths.scaled(given.spacing).chain(given)
    if moved is not None:
        masses = tuple((moved.masses - 1).tolist())
        of_drag = given.mass * given.spacing**2
        damping, friction = moved.drag
        chain = replace(
            chain,
            damping=of_drag * max(damping, 0.0),
            deviations=replace(chain.deviations, mass=masses, damping=()),
        )
        deviations['mass'] = moved.mass_deviations
        forces = {
            'damping_deviation': of_drag * moved.drag_deviations[0],
            'friction': of_drag * friction,
            'friction_deviation': of_drag * moved.drag_deviations[1],
            'spacing_deviation': math.nan if spacing_known else moved.gravity_deviation,
        }
    warnings = list(_obstacles(chain))
    if found.noise > _STRAINED * reading_noise:
        warnings.append(
            f'bonds leave {found.noise / reading_noise:.2g} times the noise of the readings: '
            'springs give way about a fast soliton, or pivots have play, and standard deviations '
            'are too small; record a slower soliton, with its kick before the first frame'
        )
    usual = float(np.median(found.bond_noise))
    warnings += [
        f'bond {bond} leaves {found.bond_noise[bond] / usual:.2g} times the noise of most bonds: '
        'an encoder may slip there, or a pivot have play'
        for bond in np.flatnonzero(found.bond_noise > _WORSE * usual).tolist()
    ]
    return Identification(
        chain=chain,
        deviations=deviations,
        **forces,
        mass_deviation=math.nan,
        offsets=found.lengths.offsets,
        offset_deviations=offset,
        noise=found.noise,
        reading_noise=reading_noise,
        bond_noise=found.bond_noise,
        tolerance=found.tolerances.of_lengths,
        rigid=rigid,
        open_combinations=_open_combinations(
            found.information, measurable(found.lengths), split_lengths
        ),
        warnings=tuple(warnings),
    )


def _bars_moved(
    found: Adjustment, readings: Readings, given: Chain, spacing_known: bool
) -> BarMotion | None:
    """What the free motion of bars shows, None where they do not move freely."""
    some = readings.every(_MOST_FITTED)
    acceleration = some.gravity.acceleration / given.spacing
    some = replace(some, gravity=replace(some.gravity, acceleration=acceleration))
    noise = max(found.noise, _LEAST_NOISE)
    try:
        return bar_motion(some, found.lengths, found.covariance, noise, spacing_known)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None


def _obstacles(chain: Chain) -> tuple[str, ...]:
    return tuple(
        f'bond {each.bond} may stop a wall: {each.rest_length:.4g} m {each.reason}'
        for each in find_obstacles(chain)
    )


def _open_combinations(
    information: Array, basis: Array, parts: Callable[[Array], dict[str, Array]]
) -> tuple[str, ...]:
    """What the readings alone tell less well than workshops make it, the least first."""
    values, vectors = np.linalg.eigh(basis.T @ information @ basis)
    loose = [
        _in_words(max(float(value), _LEAST_TOLD) ** -0.5, parts(basis @ vector))
        for value, vector in zip(values, vectors.T, strict=True)
        if value < _OPEN**-2
    ]
    more = (f'{len(loose) - _MOST_SAID} more',) if len(loose) > _MOST_SAID else ()
    return (*loose[:_MOST_SAID], *more)


def _in_words(spread: float, parts: dict[str, Array]) -> str:
    """Say which rotors and lengths a combination is of, and by how much it is open."""
    size = max(float(np.abs(part).max()) for part in parts.values())
    kinds = [name for name, part in parts.items() if np.abs(part).max() > 0.5 * size]
    sides = [
        np.concatenate([np.flatnonzero(sign * part > 0.5 * size) for part in parts.values()])
        for sign in (1, -1)
    ]
    large = min((side for side in sides if len(side)), key=np.ptp)
    what = 'scale' if set(kinds) == _OF_SCALE else ' and '.join(kinds)
    much = 'not at all' if spread >= _LEAST_TOLD**-0.5 else f'to {spread:.0%}'
    return f'{what} of rotors {large.min()} to {large.max()} against the others: {much}'
