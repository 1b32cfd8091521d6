# SPDX-License-Identifier: Apache-2.0
"""What one state of a known chain shows: its energies, topology, edge rotors, wobble and width.

Walls are given by their places [rotor spacings], found elsewhere. The noise of the angles [rad]
and of the rates [rad/s] are standard deviations; what it adds to squares is taken off them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soliton_linkage.bands import penetration_depth, winding_number
from soliton_linkage.chain import Array, Chain, Motion, staggered, uprightness
from soliton_linkage.continuum import (
    FlipperTheory,
    SpinnerTheory,
    WallTheory,
    exact_tail,
    topological_charge,
)
from soliton_linkage.cycle import Cycle
from soliton_linkage.deviations import NO_DEVIATIONS
from soliton_linkage.motion_class import next_deviation, slope_of_next, wrapped
from soliton_linkage.rigidity import mode_centre, rigidity_bands, zero_mode
from soliton_linkage.soliton import Soliton, polarisation
from soliton_linkage.static_wall import static_wall

_REACH_IN_DEPTHS = 8
_REACH_BESIDE = 3
_ABOVE_NOISE = 4.0
_LARGEST = 0.5
_FLAT = 1e-3
_BEND = 0.3
_ROUNDING = 1e-12
_CERTAIN = 3.0
_COARSEST = 0.2


@dataclass(frozen=True)
class Energies:
    """Where the energy of a state is [J]; NaN for all that takes rates where they are unknown."""

    kinetic: float
    elastic: float
    kinetic_wake: float
    """Part of the kinetic energy that is out of reach of every wall."""
    elastic_wake: float
    """Part of the elastic energy that is out of reach of every wall."""
    kinetic_deviation: float
    """Standard deviation that noise gives the kinetic energy."""
    elastic_deviation: float
    """Standard deviation that noise gives the elastic energy."""

    @property
    def whole(self) -> float:
        """Kinetic and elastic energy [J]."""
        return self.kinetic + self.elastic

    @property
    def wake(self) -> float:
        """Energy that the walls have left behind [J]."""
        return self.kinetic_wake + self.elastic_wake

    @property
    def wall(self) -> float:
        """Energy within reach of the walls [J]."""
        return self.whole - self.wake


@dataclass(frozen=True)
class Topology:
    """Polarisations, winding numbers, charge and zero mode of a state."""

    polarisations: tuple[float, float]
    """Means before the first wall and beyond the last, +1 leaning right, -1 leaning left."""
    winding_numbers: tuple[int, int]
    """Of the uniform states that these sides are in; they differ by the charge."""
    charge: int
    """Walls of charge +1 less those of -1."""
    mode_centre: float
    """Where the zero mode sits [rotor spacings]."""


@dataclass(frozen=True)
class EdgeRotors:
    """States of the first and the last rotor."""

    toggled: tuple[bool, bool] | None
    """Whether each has toggled, against the left-leaning state; None for spinners."""
    turns: tuple[float, float]
    """Turns that each has made from a uniform state [1]; NaN for flippers."""


@dataclass(frozen=True)
class Wobble:
    """How rotors beside a wall deviate from the uniform states; NaN where it cannot be told."""

    amplitudes: tuple[float, float]
    """Overshoot of |u| beyond ub [m] before the wall and beyond it, each of one rotor.

    It is the rotor that leans the most where the wall is at rest; without wobble, d <= 1, the
    nearest that is at rest to within the noise.
    """
    amplitude_deviations: tuple[float, float]
    """Standard deviations of the amplitudes [m]."""
    rest_amplitudes: tuple[float, float]
    """The same overshoots for a wall at rest [m]."""
    tail_ratio: float
    """Deviation of a rotor over that of its inner neighbour in the tails [1]."""
    tail_ratio_deviation: float
    """Standard deviation of the ratio [1]."""
    decay_length: float
    """Distance over which the tails fall by e [m]."""
    decay_length_deviation: float
    """Standard deviation of the decay length [m]."""
    wavelength: float
    """Twice the distance of the zeros of the tails [m]; NaN where they do not change sign."""
    wavelength_deviation: float
    """Standard deviation of the wavelength [m]."""
    exact_decay_length: float
    """Theory's decay length, the penetration depth ell [m]."""
    exact_wavelength: float
    """Theory's wavelength [m]: 2 a for d > 1, else infinite."""

    @property
    def amplitude(self) -> float:
        """Amplitude on the side where a wall at rest overshoots more [m]."""
        return self.amplitudes[self._larger]

    @property
    def amplitude_deviation(self) -> float:
        """Standard deviation of that amplitude [m]."""
        return self.amplitude_deviations[self._larger]

    @property
    def rest_amplitude(self) -> float:
        """The same overshoot for a wall at rest [m]."""
        return self.rest_amplitudes[self._larger]

    @property
    def _larger(self) -> int:
        before, beyond = self.rest_amplitudes
        return int(math.isnan(before) or beyond > before)


@dataclass(frozen=True)
class Width:
    """Width w of a wall tanh(x / w) [m]; NaN where it cannot be told."""

    measured: float
    deviation: float
    """Standard deviation of what is measured [m]."""
    theory: float
    """Width of the continuum theory at the wall's speed [m]; NaN from the speed of sound on."""


@dataclass(frozen=True)
class Wall:
    """A wall at rest nearest to that of a state: which rotors are about it, and their angles."""

    first: int
    """Number of the first rotor."""
    angles: Array
    """Actual angles [rad], shape (n,), up to phi -> pi - phi and whole turns."""
    place: float
    """Place of the wall [rotor spacings]."""


def energy_reach(chain: Chain) -> float:
    """Distance from a wall beyond which energy is its wake [rotor spacings], 8 ell / a + 3.

    The energy of a moving wall falls as the square of its tails, e^(-2 x / ell), or faster where
    speed has contracted it: no more than e^-16 is beyond. Near d = 1, where ell vanishes, the
    core alone is wider; 3 spacings hold it.
    """
    return _REACH_IN_DEPTHS * penetration_depth(chain) / chain.spacing + _REACH_BESIDE


def energies(
    chain: Chain,
    angles: Array,
    rates: Array | None,
    places: ArrayLike,
    noise: float = 0.0,
    rate_noise: float = 0.0,
) -> Energies:
    """Energies of a state [J], whose walls are at places [rotor spacings], shape () or (W,).

    Angles [rad] and rates [rad/s] have shape (N,). Spring n, whose energy is (k_e / 2) (l_n -
    lbar)^2, counts at n + 1/2. Noise adds (k_e / 2) (A_n^2 + B_n^2) sigma^2 to the energy of a
    spring and (I / 2) sigma_rate^2 to that of a rotor, which are taken off, so that energies
    near 0 may come out negative. Without walls all is wake.
    """
    checked = chain.check_angles(angles)
    walls = np.atleast_1d(np.asarray(places, dtype=np.float64))
    walls = walls[np.isfinite(walls)]
    _, first, second = chain.springs(checked)
    springs = 0.5 * chain.stiffnesses * chain.spring_extensions(checked) ** 2
    springs -= 0.5 * chain.stiffnesses * (first**2 + second**2) * noise**2
    outside = _out_of_reach(chain, 0.5, chain.number_of_springs, walls)
    kinetic, kinetic_wake, kinetic_deviation = math.nan, math.nan, math.nan
    if rates is not None:
        moving = chain.check_angles(rates, 'rate')
        inertia = chain.moments_of_inertia
        rotors = 0.5 * inertia * (moving**2 - rate_noise**2)
        beyond = _out_of_reach(chain, 0.0, chain.number_of_rotors, walls)
        kinetic, kinetic_wake = float(rotors.sum()), float(rotors[beyond].sum())
        variances = (inertia * rate_noise) ** 2 * (moving**2 - rate_noise**2 / 2)
        kinetic_deviation = math.sqrt(max(float(variances.sum()), 0.0))
    return Energies(
        kinetic=kinetic,
        elastic=float(springs.sum()),
        kinetic_wake=kinetic_wake,
        elastic_wake=float(springs[outside].sum()),
        kinetic_deviation=kinetic_deviation,
        elastic_deviation=_elastic_deviation(chain, checked, noise),
    )


def topology(chain: Chain, angles: Array, places: ArrayLike) -> Topology:
    """Topology of a state with walls at places [rotor spacings], NaN or empty without.

    A side's winding number is that of the uniform state that leans as it does on the mean of its
    bonds; a side without bonds counts as the nearest of them. Raises ValueError for periodic
    ends.
    """
    checked = chain.check_angles(angles)
    mode = zero_mode(chain, checked)
    polarised = polarisation(chain, checked)
    walls = np.atleast_1d(np.asarray(places, dtype=np.float64))
    walls = walls[np.isfinite(walls)]
    bonds = np.arange(len(polarised)) + 0.5
    before = bonds <= max(float(walls.min(initial=bonds[-1])), bonds[0])
    beyond = bonds >= min(float(walls.max(initial=bonds[0])), bonds[-1])
    means = float(polarised[before].mean()), float(polarised[beyond].mean())
    left, right = (winding_number(chain, 1 if mean > 0 else -1) for mean in means)
    return Topology(means, (left, right), topological_charge(chain, checked), mode_centre(mode))


def edge_rotors(chain: Chain, angles: Array) -> EdgeRotors:
    """States of the edge rotors at angles [rad], shape (N,).

    A flipper's edge rotor toggles by passing the line from its pivot to its neighbour's mass,
    where A_0 or B_{N-2} changes sign; in the left-leaning state A_0 has the sign of d - 1 and
    B_n that of (-1)^(n+1), upside down the opposite. A spinner's turns are counted in its angle
    from theta = theta_bar, or from -theta_bar in the family of states that has no such state:
    half a turn in each passage of a wall.
    """
    checked = chain.check_angles(angles)
    if chain.motion is Motion.SPINNER:
        theta = staggered(checked)
        family = 1 if np.sin(theta[:-1] + theta[1:]).sum() > 0 else -1
        turned = (checked - chain.uniform_state(family)) / (2 * math.pi)
        return EdgeRotors(None, (float(turned[0]), float(turned[-1])))
    first, second = rigidity_bands(chain, checked)
    upright = uprightness(checked)
    at_first = first[0] * upright * (1 if chain.lean_ratio > 1 else -1) < 0
    at_last = second[-1] * upright * (-1) ** (chain.number_of_rotors - 1) < 0
    return EdgeRotors((bool(at_first), bool(at_last)), (math.nan, math.nan))


def width(chain: Chain, soliton: Soliton, velocity: float | None = None) -> Width:
    """Width of a wall that was found, and that of the theory at its speed [m].

    The velocity [m/s] is the soliton's own unless a better one is given; NaN where unknown.
    """
    speed = soliton.velocity if velocity is None else velocity
    theory = _theory(chain)
    slower = speed == 0 or abs(speed) < theory.speed_of_sound
    expected = theory.width(speed) if slower else math.nan
    return Width(soliton.width, soliton.width_deviation, expected)


def wall_at(chain: Chain, place: float) -> Wall:
    """Wall at rest at a place [rotor spacings], half a spacing or more from both ends.

    Without deviations, and with edge rotors that have not toggled. Raises ValueError for a place
    nearer to an end, and as `static_wall` does.
    """
    last_place = chain.number_of_rotors - 1.5
    if not 0.5 <= place <= last_place:
        raise ValueError(
            f'place = {place} must lie from 0.5 to the number of rotors less 1.5 = {last_place}; '
            'take the wall at an edge from the cycle'
        )
    beside = math.ceil(energy_reach(chain))
    nearest = round(place)
    first, last = max(nearest - beside, 0), min(nearest + beside, chain.number_of_rotors - 1)
    window = replace(
        chain, number_of_rotors=2 * beside + 4, periodic=False, deviations=NO_DEVIATIONS
    )
    before = beside + 1 + (nearest - beside - 1) % 2
    angles = static_wall(window, place - nearest + before)
    shift = before - nearest
    return Wall(first, angles[first + shift : last + shift + 1], place)


def wall_on_cycle(cycle: Cycle, arc: float) -> Wall:
    """Wall at rest at an arc length [rad] of a cycle."""
    about = cycle.stretch(arc)
    return Wall(about.first, about.angles, cycle.place(arc))


def wobble(chain: Chain, angles: Array, wall: Wall, noise: float = 0.0) -> Wobble:
    """Wobble of a state beside its wall, with the noise of its angles [rad].

    Which rotors to look at is told by the wall at rest, not by the noisy angles, so that none is
    chosen for its noise. The ratio lambda is a least-squares fit to the deviations e from rest
    outwards on both sides, e' = F(e) + (lambda - lambda_0) e with F that of relaxed bars and
    lambda_0 = (1 - d) / (1 + d) its slope; the wavelength is that of a straight line through the
    zeros. Of spinners, whose rotors turn over, amplitudes are NaN. Standard deviations are those
    of the noise; phonons that reach the wall are not among it.
    """
    checked = chain.check_angles(angles)
    exact = exact_tail(chain)
    sides = [_Tail(chain, checked, wall, noise, way) for way in (-1, 1)]
    before, beyond = (each.overshoot() for each in sides)
    ratio, ratio_deviation = _ratio_of_tails(chain, sides)
    decay, decay_deviation = _decay_length(chain, ratio, ratio_deviation)
    wavelength, wavelength_deviation = _wavelength(chain, sides)
    return Wobble(
        amplitudes=(before[0], beyond[0]),
        amplitude_deviations=(before[1], beyond[1]),
        rest_amplitudes=(before[2], beyond[2]),
        tail_ratio=ratio,
        tail_ratio_deviation=ratio_deviation,
        decay_length=decay,
        decay_length_deviation=decay_deviation,
        wavelength=wavelength,
        wavelength_deviation=wavelength_deviation,
        exact_decay_length=exact.decay_length,
        exact_wavelength=2 * math.pi / exact.wave_number if exact.wave_number else math.inf,
    )


class _Tail:
    """Rotors on one side of a wall outwards, without that at the edge of the chain."""

    def __init__(self, chain: Chain, angles: Array, wall: Wall, noise: float, way: int) -> None:
        self._chain = chain
        self._noise = max(noise, _ROUNDING)
        inner = math.floor(wall.place) if way < 0 else math.floor(wall.place) + 1
        outer = wall.first if way < 0 else wall.first + len(wall.angles) - 1
        outer = max(outer, 1) if way < 0 else min(outer, chain.number_of_rotors - 2)
        self.rotors = np.arange(inner, outer + way, way)
        self.expected = self._deviations(wall.angles[self.rotors - wall.first], self.rotors)
        self.measured = self._deviations(angles[self.rotors], self.rotors)

    def overshoot(self) -> tuple[float, float, float]:
        """Overshoot of one rotor [m]: measured, its deviation, and that at rest; else NaN."""
        chain, rest = self._chain, self._chain.rest_angle
        if chain.motion is Motion.SPINNER or not len(self.rotors):
            return math.nan, math.nan, math.nan
        if chain.lean_ratio > 1:
            at = int(np.argmax(np.sin(rest + self.expected)))
        else:
            calm = np.abs(self.expected) < max(self._noise, _FLAT * rest)
            at = int(np.argmax(calm)) if calm.any() else len(calm) - 1
        length, expected = chain.rotor_length, float(self.expected[at])
        leans = [
            length * math.sin(rest + float(each[at])) for each in (self.measured, self.expected)
        ]
        deviation = length * abs(math.cos(rest + expected)) * self._noise
        lean = length * math.sin(rest)
        return leans[0] - lean, deviation, leans[1] - lean

    def standing_out(self) -> NDArray[np.int64]:
        """Indices of rotors in the tail, above the noise and not so large as to be in the core."""
        sizes = np.abs(self.expected)
        inside = np.flatnonzero(sizes > _LARGEST * self._chain.rest_angle)
        beyond = int(inside[-1]) + 1 if len(inside) else 0
        low = ~(sizes[beyond:] > _ABOVE_NOISE * self._noise)
        return np.arange(beyond, beyond + int(np.argmax(low)) if low.any() else len(sizes))

    def ratio(self, expected: float) -> tuple[float, float, float]:
        """Sums of e (e' - F(e)) and e^2, and the variance of the first.

        Noise in e itself makes the first less by the slopes times its variance, taken off here.
        """
        rest, noise = self._chain.rest_angle, self._noise
        inner = self.standing_out()
        inner = inner[inner + 1 < len(self.measured)]
        e, beyond = self.measured[inner], self.measured[inner + 1]
        slope = slope_of_next(e, rest, expected)
        product = e @ (beyond - next_deviation(e, rest, expected)) + slope.sum() * noise**2
        shares = np.append(-slope * e, 0.0)
        shares[1:] += e
        return float(product), float(e @ e), noise**2 * float(shares @ shares)

    def half_wavelength(self) -> tuple[float, float]:
        """Distance of the zeros of the tail and its deviation [rotor spacings]; NaN for none.

        The tail is drawn straight from rotor to rotor, where it changes its sign at each.
        Weights are those of the noise and of how far a large deviation moves a zero, 0.3 e /
        theta_bar.
        """
        e = self.measured[self.standing_out()]
        same = np.flatnonzero(e[:-1] * e[1:] >= 0)
        e = e[int(same[-1]) + 1 :] if len(same) else e
        if len(e) < 3:
            return math.nan, math.nan
        steps = e[:-1] - e[1:]
        zeros = np.arange(len(steps)) + e[:-1] / steps
        by_inner, by_outer = -e[1:] / steps**2, e[:-1] / steps**2
        bent = (_BEND * e[:-1] / self._chain.rest_angle) ** 2
        variances = self._noise**2 * (by_inner**2 + by_outer**2) + bent
        number = np.arange(len(steps)) - np.average(np.arange(len(steps)), weights=1 / variances)
        shares = number / variances / float(number**2 @ (1 / variances))
        of_rotors = np.append(shares * by_inner, 0.0)
        of_rotors[1:] += shares * by_outer
        variance = self._noise**2 * float(of_rotors @ of_rotors) + float(shares**2 @ bent)
        return float(shares @ zeros), math.sqrt(variance)

    def _deviations(self, angles: Array, rotors: NDArray[np.int64]) -> Array:
        """Angles of leaning less that of the uniform state [rad]."""
        theta = np.where(rotors % 2, math.pi - angles, angles)
        if not len(theta):
            return theta
        outer = theta[len(theta) // 2 :]
        lean = 1 if np.sin(outer).sum() > 0 else -1
        upright = 1 if np.cos(outer).sum() > 0 else -1
        return wrapped(lean * upright * theta + (upright < 0) * math.pi - self._chain.rest_angle)


def _out_of_reach(chain: Chain, first: float, count: int, walls: Array) -> NDArray[np.bool_]:
    """Whether rotors or springs, of which the first is at a place, are in the wake, (count,)."""
    places = first + np.arange(count)
    distances = np.abs(places[:, None] - walls)
    if chain.periodic:
        distances = np.minimum(distances, chain.number_of_rotors - distances)
    return np.asarray(distances.min(axis=1, initial=math.inf) > energy_reach(chain))


def _elastic_deviation(chain: Chain, angles: Array, noise: float) -> float:
    """Standard deviation of the elastic energy [J] under noise, from torques and stiffness.

    Var V = sigma^2 |tau|^2 + sigma^4 |H|^2 / 2 with H = R^T k_e R; torques measured with noise
    have sigma^2 |H|^2 too much.
    """
    torques = chain.spring_torques(angles)
    first, second = rigidity_bands(chain, angles)
    stiffness = chain.stiffnesses
    diagonal = chain.gathered(stiffness * first**2, stiffness * second**2)
    squares = float(diagonal @ diagonal) + 2 * float(np.sum((stiffness * first * second) ** 2))
    pulling = max(float(torques @ torques) - noise**2 * squares, 0.0)
    return noise * math.sqrt(pulling + noise**2 * squares / 2)


def _ratio_of_tails(chain: Chain, sides: list[_Tail]) -> tuple[float, float]:
    """Ratio lambda of the tails on both sides, and its deviation [1]."""
    expected = _exact_ratio(chain)
    product, square, variance = np.sum([each.ratio(expected) for each in sides], axis=0).tolist()
    if square <= 0:
        return math.nan, math.nan
    return expected + product / square, math.sqrt(variance) / square


def _decay_length(chain: Chain, ratio: float, deviation: float) -> tuple[float, float]:
    """Return -a / ln|lambda| and its deviation [m].

    Whether it can be told, to a fifth, is judged by the exact ratio, so that the noise has no
    part in the choice.
    """
    known = abs(_exact_ratio(chain))
    if not (known > _CERTAIN * deviation and 0 < abs(ratio) < 1):
        return math.nan, math.nan
    if deviation > _COARSEST * known * abs(math.log(known)):
        return math.nan, math.nan
    length = -chain.spacing / math.log(abs(ratio))
    return length, length**2 * deviation / (chain.spacing * abs(ratio))


def _exact_ratio(chain: Chain) -> float:
    """Return lambda_0 = (1 - d) / (1 + d)."""
    return (1 - chain.lean_ratio) / (1 + chain.lean_ratio)


def _wavelength(chain: Chain, sides: list[_Tail]) -> tuple[float, float]:
    """Twice the distance of the zeros on both sides, and its deviation [m]."""
    found = np.array([each.half_wavelength() for each in sides])
    found = found[np.isfinite(found[:, 0])]
    if not len(found):
        return math.nan, math.nan
    weights = 1 / found[:, 1] ** 2
    mean = float(np.average(found[:, 0], weights=weights))
    return 2 * chain.spacing * mean, 2 * chain.spacing / math.sqrt(float(weights.sum()))


def _theory(chain: Chain) -> WallTheory:
    return SpinnerTheory(chain) if chain.motion is Motion.SPINNER else FlipperTheory(chain)
