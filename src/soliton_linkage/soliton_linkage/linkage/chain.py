# SPDX-License-Identifier: Apache-2.0
"""Geometry, energy and torques of the chain of rotors.

Springs join neighbouring masses. The symbols are the angle phi_n of rotor n, the rotor length r,
the mass M, the distance a between neighbouring pivots, the rest angle theta_bar, and for spring n
the length l_n, the rest length lbar and the stiffness k_e. In the uniform right-leaning state, the
staggered angle theta_n of each rotor is theta_bar, where theta_n is phi_n for even n and
pi - phi_n for odd n. Relative to its pivot, mass n is at the horizontal position
h_n = r sin(phi_n) and at the height v_n = r cos(phi_n). The difference between the squared length
and the squared rest length of spring n is

    e_n = l_n^2 - lbar^2 = c + 2 a (h_{n+1} - h_n) - 2 (h_n h_{n+1} + v_n v_{n+1}),
    c = a^2 + 2 r^2 - lbar^2 = -2 r^2 cos(2 theta_bar).

Extensions are computed as e_n / (l_n + lbar). This form has smaller rounding errors than
l_n - lbar, the difference of two nearly equal lengths. In chains with deviations, each rotor has
its own r and M, and each spring its own a, lbar and k_e.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soliton_linkage.linkage.deviations import NO_DEVIATIONS, OF_SPRINGS, Deviations
from soliton_linkage.linkage.feedback import NO_FEEDBACK, Feedback
from soliton_linkage.linkage.quantities import check_quantities, document_fields, quantity
from soliton_linkage.linkage.springs import spring_between

Array = NDArray[np.float64]


class Motion(enum.Enum):
    """Class of the motion of rotors when a wall passes (Chen et al., PNAS 111, 13004 (2014))."""

    FLIPPER = 'flipper'
    WOBBLING_FLIPPER = 'wobbling flipper'
    SPINNER = 'spinner'


def _deviating(parameter: str, meaning: str) -> cached_property[Array]:
    """Return a property of `Chain`: the value of a parameter for each rotor or spring."""

    def values(chain: Chain) -> Array:
        return np.asarray(getattr(chain, parameter) * chain._factors(parameter))

    values.__doc__ = meaning
    return cached_property(values)


@document_fields
@dataclass(frozen=True)
class Chain:
    """Parameters of a chain. Raises ValueError for invalid values.

    With periodic ends, a spring joins the last rotor to a periodic image of the first rotor.
    `deviations` contains the relative deviations of single rotors or springs from the values of
    the other fields. `feedback` contains the parameters of the motor controllers.
    """

    number_of_rotors: int = quantity(40, 'number of rotors', '', 2, 100_000)
    spacing: float = quantity(0.1, 'distance between neighbouring pivots', 'm', 1e-6, 1e3)
    rotor_length: float = quantity(0.05, 'distance from pivot to mass', 'm', 1e-6, 1e3)
    rest_angle: float = quantity(
        0.97, 'staggered angle of the uniform right-leaning state', 'rad', 1e-3, 1.57
    )
    mass: float = quantity(0.02, 'mass at the end of each rotor', 'kg', 1e-9, 1e6)
    stiffness: float = quantity(50.0, 'stiffness of each spring', 'N/m', 1e-9, 1e12)
    damping: float = quantity(0.0, 'damping of each rotor about its pivot', 'N m s/rad', 0.0, 1e6)
    periodic: bool = quantity(False, 'whether a spring joins the last rotor to the first')
    dry_friction: float = quantity(
        0.0, 'torque of the dry friction of each bearing at high rates', 'N m', 0.0, 1e6
    )
    friction_rate: float = quantity(
        0.01, 'rate below which dry friction is proportional to the rate', 'rad/s', 1e-9, 1e6
    )
    quadratic_damping: float = quantity(
        0.0, 'torque on each rotor per square of its rate', 'N m s^2/rad^2', 0.0, 1e6
    )
    non_reciprocity: float = quantity(
        0.0,
        'torque of each bond on both of its rotors, per difference of their coordinates; the '
        'simulator can change it at run time',
        'N m/rad',
        -1e6,
        1e6,
    )
    on_site_torque: float = quantity(
        0.0, 'largest torque of the on-site potential of each rotor', 'N m', -1e6, 1e6
    )
    on_site_order: int = quantity(
        1, 'number of wells of the on-site potential per turn', '', 1, 100
    )
    on_site_phase: float = quantity(
        0.0, 'coordinate of a well of the on-site potential', 'rad', -10.0, 10.0
    )
    deviations: Deviations = NO_DEVIATIONS
    feedback: Feedback = NO_FEEDBACK

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.periodic and self.number_of_rotors % 2:
            raise ValueError(
                f'Chain.number_of_rotors = {self.number_of_rotors} must be even if the ends are '
                'periodic, because rotors alternately point up and down'
            )
        self.deviations.check_fit(self.number_of_rotors, self.number_of_springs)

    @property
    def number_of_springs(self) -> int:
        """Number of springs: N - 1 with free ends, N with periodic ends."""
        return self.number_of_rotors - (not self.periodic)

    spacings = _deviating('spacing', 'Distance from each pivot to the next [m], shape (springs,).')
    rotor_lengths = _deviating('rotor_length', 'Length of each rotor [m], shape (N,).')
    masses = _deviating('mass', 'Mass at the end of each rotor [kg], shape (N,).')
    stiffnesses = _deviating('stiffness', 'Stiffness of each spring [N/m], shape (springs,).')
    rest_lengths = _deviating('rest_length', 'Rest length of each spring [m], shape (springs,).')
    dampings = _deviating('damping', 'Damping of each rotor [N m s/rad], shape (N,).')
    dry_frictions = _deviating('dry_friction', 'Dry friction of each rotor [N m], shape (N,).')
    quadratic_dampings = _deviating(
        'quadratic_damping', 'Quadratic damping of each rotor [N m s^2/rad^2], shape (N,).'
    )
    non_reciprocities = _deviating(
        'non_reciprocity', 'Non-reciprocity kappa of each bond [N m/rad], shape (springs,).'
    )
    on_site_torques = _deviating(
        'on_site_torque',
        'Largest torque of the on-site potential of each rotor [N m], shape (N,).',
    )

    @cached_property
    def pivots(self) -> Array:
        """Distance of each pivot from the pivot of rotor 0 [m], shape (N,)."""
        between = self.spacings[: self.number_of_rotors - 1]
        return np.concatenate([[0.0], np.cumsum(between)])

    @cached_property
    def feedback_strengths(self) -> Array:
        """Factor that multiplies all feedback gains of a motor [1], for each rotor, shape (N,)."""
        return self._factors('feedback')

    @cached_property
    def moments_of_inertia(self) -> Array:
        """Moment of inertia of each rotor about its pivot, M r^2 [kg m^2], shape (N,)."""
        return np.asarray(self.masses * self.rotor_lengths**2)

    @cached_property
    def rest_length(self) -> float:
        """Rest length of a spring without deviation, sqrt(a^2 + 4 r^2 cos(theta_bar)^2) [m]."""
        return math.hypot(self.spacing, 2 * self.rotor_length * math.cos(self.rest_angle))

    @cached_property
    def moment_of_inertia(self) -> float:
        """Moment of inertia of a rotor without deviations, M r^2 [kg m^2]."""
        return self.mass * self.rotor_length**2

    @cached_property
    def time_unit(self) -> float:
        """Time scale of the chain [s], sqrt(M / k_e)."""
        return math.sqrt(self.mass / self.stiffness)

    @cached_property
    def lean_ratio(self) -> float:
        """Lean ratio d = 2 r sin(theta_bar) / a [1]."""
        return 2 * self.rotor_length * math.sin(self.rest_angle) / self.spacing

    @cached_property
    def critical_lean_ratio(self) -> float:
        """Critical lean ratio d_c = 2 / sin(theta_bar) [1]."""
        return 2 / math.sin(self.rest_angle)

    @cached_property
    def motion(self) -> Motion:
        """Class of motion: flipper if d <= 1, spinner if d > d_c, otherwise wobbling flipper.

        Here d is `lean_ratio` and d_c is `critical_lean_ratio`.
        """
        if self.lean_ratio > self.critical_lean_ratio:
            return Motion.SPINNER
        return Motion.WOBBLING_FLIPPER if self.lean_ratio > 1 else Motion.FLIPPER

    @cached_property
    def wall_width(self) -> float:
        """Width of a slow wall [m]: a^2 / (2 r sin(theta_bar)); r sin(theta_bar) for spinners."""
        lean = self.rotor_length * math.sin(self.rest_angle)
        return lean if self.motion is Motion.SPINNER else self.spacing**2 / (2 * lean)

    @cached_property
    def signs(self) -> Array:
        """Derivative dq/dphi of the coordinate q of each rotor, +1 or -1, shape (N,).

        The coordinate q is phi in spinners, and theta in flippers and wobbling flippers.
        """
        signs = np.ones(self.number_of_rotors)
        if self.motion is not Motion.SPINNER:
            signs[1::2] = -1.0
        return signs

    def uniform_state(self, lean: int) -> Array:
        """Return the angles of the right-leaning (+1) or left-leaning (-1) state [rad], (N,)."""
        if lean not in (-1, 1):
            raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
        return staggered(np.full(self.number_of_rotors, lean * self.rest_angle))

    def check_angles(self, angles: ArrayLike, what: str = 'angle') -> Array:
        """Return the angles as an array of shape (N,); `what` is their name in error messages.

        Raises ValueError for a wrong shape and for infinite or NaN values.
        """
        checked = np.asarray(angles, dtype=np.float64)
        check_shape(checked, self.number_of_rotors, what)
        if not math.isfinite(np.add.reduce(checked)) and not np.isfinite(checked).all():
            rotor = int(np.flatnonzero(~np.isfinite(checked))[0])
            raise ValueError(f'{what} of rotor {rotor} = {checked[rotor]} must be a finite number')
        return checked

    def positions(self, angles: Array) -> tuple[Array, Array]:
        """Return the positions h, v of the masses relative to their pivots [m], (..., N) each."""
        return self.rotor_lengths * np.sin(angles), self.rotor_lengths * np.cos(angles)

    def springs(self, angles: Array) -> tuple[Array, Array, Array]:
        """Return extensions [m] and levers A and B [m/rad] of all springs, (..., springs) each.

        The levers are A_n = dl_n/dphi_n and B_n = dl_n/dphi_{n+1}; see `springs.spring_between`.
        """
        horizontal, vertical = self.positions(angles)
        h_left, h_right = self._joined(horizontal)
        v_left, v_right = self._joined(vertical)
        parameters = self.spacings, self.offsets, self.rest_lengths
        return spring_between(h_left, v_left, h_right, v_right, *parameters)

    def spring_extensions(self, angles: Array) -> Array:
        """Return the length of each spring minus its rest length [m], shape (..., springs)."""
        return self.springs(angles)[0]

    def elastic_energy(self, angles: Array) -> Array:
        """Return the energy of the springs V = sum_n (k_e / 2) (l_n - lbar)^2 [J], shape (...)."""
        extensions = self.spring_extensions(angles)
        return np.asarray(0.5 * np.sum(self.stiffnesses * extensions**2, axis=-1))

    def kinetic_energy(self, rates: Array) -> Array:
        """Return the kinetic energy [J], T = sum_n (M r^2 / 2) phi_dot_n^2, shape (...)."""
        return np.asarray(0.5 * np.sum(self.moments_of_inertia * np.square(rates), axis=-1))

    def spring_torques(self, angles: Array) -> Array:
        """Return the torque of the springs on each rotor [N m], -dV/dphi, shape (..., N)."""
        extensions, first, second = self.springs(angles)
        pull = -self.stiffnesses * extensions
        return self.gathered(pull * first, pull * second)

    def gathered(self, lefts: Array, rights: Array) -> Array:
        """Return the sum of the springs' contributions to each rotor, shape (..., N).

        Spring n contributes `lefts[..., n]` to rotor n and `rights[..., n]` to rotor n + 1.
        """
        if self.periodic:
            return np.asarray(lefts + np.roll(rights, 1, axis=-1))
        sums = np.zeros((*np.shape(lefts)[:-1], self.number_of_rotors))
        sums[..., :-1] = lefts
        sums[..., 1:] += rights
        return sums

    @cached_property
    def offsets(self) -> Array:
        """Offset c of each spring [m^2], shape (springs,); the module docstring defines c."""
        uniform = -2 * self.rotor_length**2 * math.cos(2 * self.rest_angle)
        r_left, r_right = self._joined(self.rotor_lengths)
        deviating = (self.spacings**2 - self.spacing**2) + (r_left**2 - self.rotor_length**2)
        deviating += r_right**2 - self.rotor_length**2
        return np.asarray(uniform + (deviating - (self.rest_lengths**2 - self.rest_length**2)))

    @cached_property
    def spring_parameters(self) -> Array:
        """Lengths r [m] of the rotors, and a [m], c [m^2] and lbar [m] of the springs, (4, N).

        Each row contains one quantity. With free ends, the last element of the spring rows is 0.
        """
        rows = np.zeros((4, self.number_of_rotors))
        rows[0] = self.rotor_lengths
        rows[1:, : self.number_of_springs] = self.spacings, self.offsets, self.rest_lengths
        return rows

    def _joined(self, values: Array) -> tuple[Array, Array]:
        """Return `values` at the left and the right rotor of each spring, (..., springs) each."""
        if self.periodic:
            return values, np.roll(values, -1, axis=-1)
        return values[..., :-1], values[..., 1:]

    def _factors(self, parameter: str) -> Array:
        deviations = getattr(self.deviations, parameter)
        of_springs = parameter in OF_SPRINGS
        count = self.number_of_springs if of_springs else self.number_of_rotors
        return 1 + np.array(deviations) if deviations else np.ones(count)


def staggered(angles: ArrayLike) -> Array:
    """Convert angles phi to staggered angles theta, or theta to phi [rad], shape (..., N).

    theta_n = phi_n for even n, and theta_n = pi - phi_n for odd n.
    """
    converted = np.array(angles, dtype=np.float64)
    converted[..., 1::2] = np.pi - converted[..., 1::2]
    return converted


def displacement(chain: Chain, angles: ArrayLike) -> Array:
    """Return the displacement of each mass, u = r sin(theta) = r sin(phi) [m], shape (..., N)."""
    return chain.positions(np.asarray(angles, dtype=np.float64))[0]


def uprightness(angles: ArrayLike) -> int:
    """Return -1 if the chain is upside down, otherwise +1.

    The result is the sign of the sum of cos(theta) over all rotors except the first and the last
    one, because a wall that is reflected at an edge leaves the edge rotor at another angle.
    """
    vertical = np.cos(angles)
    return -1 if vertical[2:-1:2].sum() < vertical[1:-1:2].sum() else 1


def check_shape(values: ArrayLike, rotors: int, what: str = 'angle') -> None:
    """Raise ValueError unless the values have the shape (rotors,)."""
    shape = values.shape if isinstance(values, np.ndarray) else np.shape(values)
    if shape != (rotors,):
        raise ValueError(
            f'{what}s of shape {shape} do not fit a chain of {rotors} rotors; give one per rotor'
        )


def wrapped(differences: ArrayLike) -> Array:
    """Wrap differences of angles to the range -pi to pi [rad], shape (...)."""
    given = np.asarray(differences, dtype=np.float64)
    return np.asarray(given - 2 * math.pi * np.rint(given * (0.5 / math.pi)))
