# SPDX-License-Identifier: Apache-2.0
"""Solitons in one frame of angles: their positions, velocities, widths and charges.

The polarisation of a bond (see `polarisation`) is positive if the zero mode grows towards the last
rotor, and negative if it grows towards the first rotor. A wall is detected where the polarisation
changes its sign. The order field m_n of rotor n is +1 where the chain leans right and -1 where it
leans left. The function m_n = -Q tanh((n - X) / w) of a wall of charge Q is fitted to the order
field twice. The first fit gives the position X; its w is fixed at
the width of a slow wall. The second fit of both X and w gives the width w. The bias of the
position is below 0.002 rotor spacings for lean ratios d < 0.9 or d > 2.5 d_c, below 0.1 for d < 2
or d > 1.4 d_c, and otherwise up to 2, because the order field is then not a tanh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import minimum_filter1d

from soliton_linkage.linear.bands import couplings
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered

DOMAIN = 0.5
"""Threshold of a domain: a bond belongs to a domain, and not to a wall, if its absolute
polarisation exceeds this [1]. In a uniform state, the absolute polarisation is 1."""
_FIT_ITERATIONS = 12
"""Largest number of Newton steps of a fit [1]."""
_FIT_REACH = 4.0
"""Largest distance from the wall at which rotors are included in the fit [wall widths]; one rotor
spacing is added. At larger distances, 1 - |tanh| is below 7e-4."""
WIDEST_LEAN_RATIO = 2.0
"""Lean ratio d [1] below which walls of flippers and wobbling flippers have the profile
tanh(x / w). At this lean ratio and above, the width w of their walls is not defined, and is NaN in
`Soliton`."""


@dataclass(frozen=True)
class Soliton:
    """Domain wall in one frame.

    A quantity that the frame does not determine is NaN.

    rotor: site coordinate of the centre [rotor spacings]; rotor 0 has the coordinate 0.
    position: distance of the centre from the pivot of rotor 0 [m].
    velocity: velocity of the centre [m/s], positive towards the last rotor.
    width: width w in tanh(x / w) [m].
    charge: +1 if the chain leans right on the side of rotor 0 and left on the other side, else -1.
    position_deviation: standard deviation of the position [m].
    velocity_deviation: standard deviation of the velocity [m/s].
    width_deviation: standard deviation of the width [m].
    """

    rotor: float
    position: float
    velocity: float
    width: float
    charge: int
    position_deviation: float
    velocity_deviation: float
    width_deviation: float


def polarisation(chain: Chain, angles: Array) -> Array:
    """Return the polarisation of each bond [1], shape (..., springs).

    The polarisation is the ratio (A^2 - B^2) / (A^2 + B^2) of the levers A and B, divided by the
    value of this ratio in the right-leaning state. Therefore, it is +1 in the right-leaning state
    and -1 in the left-leaning state.
    """
    first, second = rigidity_bands(chain, angles)
    plus, minus = couplings(chain)
    uniform = (plus**2 - minus**2) / (plus**2 + minus**2)
    strength = first**2 + second**2
    return np.asarray((first**2 - second**2) / (np.where(strength > 0, strength, 1.0) * uniform))


def order_field(chain: Chain, angles: Array) -> tuple[Array, Array]:
    """Return the order field m [1] and its derivative dm/dphi [1/rad], each of shape (N,).

    For flippers, m = sin(theta) / sin(theta_bar). For spinners, m = cos(theta - theta_bar) in the
    family +1 and m = -cos(theta + theta_bar) in the family -1 (see `SpinnerTheory`).
    """
    theta = staggered(angles)
    turn = np.where(np.arange(theta.shape[-1]) % 2, -1.0, 1.0)
    if chain.motion is not Motion.SPINNER:
        scale = math.sin(chain.rest_angle)
        return np.sin(theta) / scale, turn * np.cos(theta) / scale
    first, second = rigidity_bands(chain, angles)
    levers = second - first
    lean = 1 if levers[::2].sum() > levers[1::2].sum() else -1
    shifted = theta - lean * chain.rest_angle
    return lean * np.cos(shifted), -lean * turn * np.sin(shifted)


def find_solitons(chain: Chain, angles: Array, rates: Array | None = None) -> tuple[Soliton, ...]:
    """Return the walls in a frame of angles [rad] and rates [rad/s], (N,), sorted by their sites.

    Without rates, the velocities are NaN. In periodic chains, sites are from 0 to N.
    """
    checked = chain.check_angles(angles)
    moving = None if rates is None else chain.check_angles(rates, 'rate')
    field, slope = order_field(chain, checked)
    polarised = polarisation(chain, checked)
    if chain.periodic:
        return _walls_of_ring(chain, polarised, field, slope, moving)
    return _fitted(chain, _polarisation_crossings(polarised), field, slope, moving)


def _fitted(
    chain: Chain,
    crossings: list[tuple[float, int]],
    field: Array,
    slope: Array,
    rates: Array | None,
) -> tuple[Soliton, ...]:
    sites = [crossing for crossing, _ in crossings]
    between = [(site + following) / 2 for site, following in pairwise(sites)]
    borders = pairwise([-math.inf, *between, math.inf])
    found = []
    for (crossing, charge), (low, high) in zip(crossings, borders, strict=False):
        bounds = max(low, crossing - 1), min(high, crossing + 1)
        found.append(_TanhFit(chain, field, slope, crossing, charge, bounds).soliton(rates))
    return tuple(found)


def _walls_of_ring(
    chain: Chain, polarised: Array, field: Array, slope: Array, rates: Array | None
) -> tuple[Soliton, ...]:
    rotors = chain.number_of_rotors
    reach = math.ceil(_FIT_REACH * chain.wall_width / chain.spacing) + 2
    clear = minimum_filter1d(np.abs(polarised), min(2 * reach + 1, rotors), mode='wrap')
    cut = int(np.argmax(clear)) + 1
    polarised, field, slope = (np.roll(values, -cut) for values in (polarised, field, slope))
    rates = None if rates is None else np.roll(rates, -cut)
    shifted = []
    for soliton in _fitted(chain, _polarisation_crossings(polarised[:-1]), field, slope, rates):
        site = (soliton.rotor + cut) % rotors
        shifted.append(replace(soliton, rotor=site, position=site * chain.spacing))
    return tuple(sorted(shifted, key=lambda soliton: soliton.rotor))


class _TanhFit:
    """Least-squares fit of m_n = -Q tanh((n - X) / w) to the order field near a change of sign."""

    def __init__(
        self,
        chain: Chain,
        field: Array,
        slope: Array,
        crossing: float,
        charge: int,
        bounds: tuple[float, float],
    ) -> None:
        self._chain = chain
        self._charge = charge
        self._width = chain.wall_width / chain.spacing
        reach = _FIT_REACH * self._width + 1
        first, last = 0, chain.number_of_rotors - 1
        if chain.motion is not Motion.SPINNER:
            # An edge rotor of a flipper has two rest angles, and |m| is not 1 at one of them.
            first, last = first + 1, last - 1
        first = max(first, math.ceil(crossing - reach))
        last = min(last, math.floor(crossing + reach))
        self._rotors = np.arange(first, last + 1, dtype=np.float64)
        self._field = field[first : last + 1]
        self._slope = slope[first : last + 1]
        self._centre = self._fit_centre(crossing, bounds)

    def soliton(self, rates: Array | None) -> Soliton:
        gradient, _ = self._gradient_and_curvature(self._centre)
        residual = self._field - self._model(self._centre)
        deviation = _deviation(residual, 1, float(gradient @ gradient))
        velocity, velocity_deviation = self._velocity(rates)
        width, width_deviation = self._fit_width()
        spacing = self._chain.spacing
        return Soliton(
            rotor=self._centre,
            position=self._centre * spacing,
            velocity=velocity * spacing,
            width=width * spacing,
            charge=self._charge,
            position_deviation=deviation * spacing,
            velocity_deviation=velocity_deviation * spacing,
            width_deviation=width_deviation * spacing,
        )

    def _velocity(self, rates: Array | None) -> tuple[float, float]:
        """Return the rate of the wall's centre and its standard deviation [rotor spacings / s].

        The rate follows from the time derivative of the condition sum_n (m_n - f_n) df_n/dX = 0,
        where f_n is the fitted function.
        """
        if rates is None or len(self._rotors) < 2:
            return math.nan, math.nan
        first = int(self._rotors[0])
        change = self._slope * rates[first : first + len(self._rotors)]
        gradient, curvature = self._gradient_and_curvature(self._centre)
        stiffness = float(
            gradient @ gradient - (self._field - self._model(self._centre)) @ curvature
        )
        if stiffness <= 0:
            return math.nan, math.nan
        velocity = float(gradient @ change) / stiffness
        residual = change - velocity * gradient
        return velocity, _deviation(residual, 1, float(gradient @ gradient))

    def _fit_width(self) -> tuple[float, float]:
        chain = self._chain
        edge = min(self._centre, chain.number_of_rotors - 1 - self._centre)
        wobbling = chain.motion is not Motion.SPINNER
        undefined = wobbling and chain.lean_ratio >= WIDEST_LEAN_RATIO
        if undefined or edge < 2 * self._width or len(self._rotors) < 4:
            return math.nan, math.nan
        centre, width = self._centre, self._width
        for _ in range(_FIT_ITERATIONS):
            argument = (self._rotors - centre) / width
            by_centre = self._charge / width * _sech_squared(argument)
            jacobian = np.stack([by_centre, by_centre * argument], axis=1)
            residual = self._field + self._charge * np.tanh(argument)
            normal = jacobian.T @ jacobian
            if np.linalg.det(normal) <= 0:
                return math.nan, math.nan
            step = np.linalg.solve(normal, jacobian.T @ residual)
            centre += float(np.clip(step[0], -0.5, 0.5))
            width *= math.exp(float(np.clip(step[1] / width, -0.5, 0.5)))
            if not 0.1 * self._width < width < 4 * self._width:
                return math.nan, math.nan
        deviation = _deviation(residual, 2, 1 / float(np.linalg.inv(normal)[1, 1]))
        return (width, deviation) if deviation < width / 2 else (math.nan, math.nan)

    def _fit_centre(self, crossing: float, bounds: tuple[float, float]) -> float:
        centre = crossing
        for _ in range(_FIT_ITERATIONS if len(self._rotors) > 1 else 0):
            gradient, curvature = self._gradient_and_curvature(centre)
            residual = self._field - self._model(centre)
            hessian = float(gradient @ gradient)
            if hessian < 1e-12:
                break
            hessian = max(hessian - float(residual @ curvature), hessian / 4)
            step = float(gradient @ residual) / hessian
            centre = min(max(centre + step, bounds[0]), bounds[1])
            if abs(step) < 1e-13 * self._chain.number_of_rotors:
                break
        return centre

    def _model(self, centre: float) -> Array:
        return np.asarray(-self._charge * np.tanh((self._rotors - centre) / self._width))

    def _gradient_and_curvature(self, centre: float) -> tuple[Array, Array]:
        argument = (self._rotors - centre) / self._width
        gradient = self._charge / self._width * _sech_squared(argument)
        return gradient, 2 * gradient * np.tanh(argument) / self._width


def _sech_squared(argument: ArrayLike) -> Array:
    return np.asarray(1 - np.tanh(argument) ** 2)


def _deviation(residual: Array, parameters: int, information: float) -> float:
    """Return the standard deviation of a fitted parameter, or NaN if it is undetermined.

    With the Jacobian J of the fit, `information` is the inverse of the diagonal element of
    (J^T J)^-1 that belongs to the parameter.
    """
    freedom = len(residual) - parameters
    if freedom < 1 or information <= 0:
        return math.nan
    return math.sqrt(float(residual @ residual) / freedom / information)


def _polarisation_crossings(polarised: Array) -> list[tuple[float, int]]:
    bonds = np.flatnonzero(np.abs(polarised) > DOMAIN)
    signs = np.sign(polarised[bonds])
    crossings = []
    for change in np.flatnonzero(signs[1:] != signs[:-1]):
        left, right = bonds[change], bonds[change + 1]
        part = polarised[left] / (polarised[left] - polarised[right])
        crossings.append((float(left + 0.5 + part * (right - left)), int(signs[change])))
    return crossings


def charge_of_field(displacements: ArrayLike, lean: float) -> float:
    """Return the topological charge of a field u(x), Q = [u(-inf) - u(+inf)] / (2 ub) [1].

    `displacements` are the values of u along the chain [m], and `lean` is ub [m]. A wall with zero
    energy has the charge +1. The paper (equation `soliton_charge`) has the opposite sign.
    """
    if not (math.isfinite(lean) and lean > 0):
        raise ValueError(f'lean = {lean} m must be a finite number above 0')
    field = np.asarray(displacements, dtype=np.float64)
    return float(field[0] - field[-1]) / (2 * lean)


def topological_charge(chain: Chain, angles: ArrayLike) -> int:
    """Return the number of kinks (charge +1) minus the number of anti-kinks: 1, 0 or -1."""
    if chain.periodic:
        chain.check_angles(angles)
        return 0
    polarised = polarisation(chain, chain.check_angles(angles))
    signs = np.sign(polarised[np.abs(polarised) > DOMAIN])
    return int(signs[0] - signs[-1]) // 2 if len(signs) else 0


def half_turns(chain: Chain, angles: ArrayLike) -> int:
    """Return the number of half turns of the last rotor of a spinner relative to the first rotor.

    Let x_n be the angle phi_n minus its value in a uniform state of the family of the spinner (see
    `SpinnerTheory`). A wall contributes +1 if x_n is half a turn larger on the side of the last
    rotor than on the side of rotor 0, and -1 if it is half a turn smaller. Whole turns between
    neighbouring rotors do not count. Raises ValueError for a flipper.
    """
    if chain.motion is not Motion.SPINNER:
        raise ValueError(f'a {chain.motion.value} does not turn; count the turns of a spinner')
    checked = chain.check_angles(angles)
    theta = staggered(checked)
    family = 1 if np.sin(theta[:-1] + theta[1:]).sum() > 0 else -1
    steps = np.diff(checked - chain.uniform_state(family)) / (2 * np.pi)
    return round(2 * float(np.sum(steps - np.round(steps))))
