# SPDX-License-Identifier: Apache-2.0
"""Identification of a pneumatic actuator from a step response and from steady torques."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.linkage.chain import Array

_FEWEST_READINGS = 4
"""Smallest number of readings of a step response [1]: one more than the unknowns of the fit, which
are the filling time, the venting time and the initial pressure."""
_SHORTEST_STEP = 0.05
"""The initial guess uses only those intervals between readings in which |command - pressure| is
above this fraction of its largest value [1]."""


@dataclass(frozen=True)
class StepResponse:
    """Record of the pressure while the commanded pressure steps up and down."""

    times: Array
    """Times of the readings [s], shape (readings,), increasing."""
    commands: Array
    """Commanded pressure between each reading and the next one [Pa], shape (readings,)."""
    pressures: Array
    """Measured pressure in the chamber [Pa], shape (readings,)."""

    def __post_init__(self) -> None:
        columns = (self.times, self.commands, self.pressures)
        if len({column.shape for column in columns}) != 1 or self.times.ndim != 1:
            raise ValueError('times, commands and pressures must have the same shape, (readings,)')
        if len(self.times) < _FEWEST_READINGS:
            raise ValueError(
                f'a step response has {len(self.times)} readings, but must have at least '
                f'{_FEWEST_READINGS}; record at a higher rate or for longer'
            )
        if not all(np.isfinite(column).all() for column in columns):
            raise ValueError('times, commands and pressures must be finite; remove other readings')
        if np.any(np.diff(self.times) <= 0):
            raise ValueError(
                'the times of a step response must increase; sort them and remove duplicates'
            )


@dataclass(frozen=True)
class PneumaticFit:
    """Time constants of an actuator, fitted to a step response by least squares."""

    filling_time: float
    """Time constant of rising pressure [s]."""
    venting_time: float
    """Time constant of falling pressure [s]."""
    filling_deviation: float
    """Standard deviation of the filling time [s], estimated from the residuals."""
    venting_deviation: float
    """Standard deviation of the venting time [s], estimated from the residuals."""
    residual: float
    """Root mean square of the residuals [Pa]."""


def fit_step_response(response: StepResponse) -> PneumaticFit:
    """Estimate the time constants of filling and venting by least squares.

    The pressure p follows the command u as dp/dt = (u - p) / tau, with the filling time as tau
    while p rises and the venting time while p falls. Raises ValueError if the pressure never rises
    or never falls towards the command.

    >>> times = np.linspace(0, 1, 201)
    >>> commands = np.where(times < 0.5, 1e5, 0.0)
    >>> pressures = PneumaticActuator(filling_time=0.04).responses(0.0, times, commands)
    >>> fit = fit_step_response(StepResponse(times, commands, pressures))
    >>> round(fit.filling_time, 6), round(fit.venting_time, 6)
    (0.04, 0.05)
    """
    guess = np.array([_time_constant(response, sign) for sign in (1, -1)])
    deviation = np.abs(response.pressures - response.commands).max()

    def misfit(unknowns: Array) -> Array:
        filling, venting = np.exp(unknowns[:2])
        actuator = replace(PneumaticActuator(), filling_time=filling, venting_time=venting)
        start = deviation * unknowns[2]
        expected = actuator.responses(float(start), response.times, response.commands)
        return np.asarray((expected - response.pressures) / deviation)

    first = np.append(np.log(np.clip(guess, 1e-3, 1e2)), response.pressures[0] / deviation)
    bounds = ([np.log(1e-4)] * 2 + [-np.inf], [np.log(1e3)] * 2 + [np.inf])
    solution = least_squares(misfit, first, bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    freedom = len(response.times) - len(first)
    variance = 2 * solution.cost / freedom
    covariance = variance * np.linalg.pinv(solution.jac.T @ solution.jac)
    filling, venting = np.exp(solution.x[:2]).tolist()
    spread = np.sqrt(np.diag(covariance)).tolist()
    residual = float(deviation * np.sqrt(np.mean(solution.fun**2)))
    return PneumaticFit(filling, venting, filling * spread[0], venting * spread[1], residual)


def fit_torque(pressures: Array, torques: Array) -> tuple[float, float]:
    """Estimate the torque per pressure [N m/Pa] and the saturation torque [N m].

    `pressures` [Pa] and `torques` [N m] contain steady readings, shape (readings,). The model
    clip(k p, -limit, limit) is fitted by least squares. A finite limit is returned only if it at
    least halves the sum of squared residuals of the straight line k p. Otherwise the readings show
    no saturation: the returned limit is infinite, and readings at larger pressures are required.
    Raises ValueError for fewer than two readings or if all pressures are 0.
    """
    order = np.argsort(np.abs(pressures))
    pressed, twisted = np.abs(pressures[order]), np.sign(pressures[order]) * torques[order]
    if len(pressed) < 2 or not pressed[-1] > 0:
        raise ValueError(
            'torques must be read at two pressures or more, one of them not 0; add readings'
        )
    # The readings at the largest pressures are saturated. If their number is known, the fit is
    # linear. Therefore each possible number is tried.
    fits = [_split_fit(pressed, twisted, count) for count in range(1, len(pressed) + 1)]
    straight = fits[-1]
    best = min((fit for fit in fits if fit is not None), default=None)
    if straight is None or best is None:
        raise ValueError('torques must be read at pressures other than 0; add readings')
    rounding = float(np.finfo(np.float64).eps * np.linalg.norm(twisted) * len(twisted)) ** 2
    _, slope, limit = best if 2 * best[0] + rounding < straight[0] else straight
    return slope, limit


def _split_fit(pressed: Array, twisted: Array, linear: int) -> tuple[float, float, float] | None:
    squares = float(pressed[:linear] @ pressed[:linear])
    if not squares:
        return None
    slope = float(pressed[:linear] @ twisted[:linear]) / squares
    saturated = twisted[linear:]
    limit = float(saturated.mean()) if len(saturated) else np.inf
    if slope * pressed[linear - 1] > limit:
        return None
    expected = np.minimum(slope * pressed, limit)
    return float(np.sum((expected - twisted) ** 2)), slope, limit


def _time_constant(response: StepResponse, sign: int) -> float:
    middle = (response.pressures[1:] + response.pressures[:-1]) / 2
    driven = response.commands[:-1] - middle
    reach = sign * driven > _SHORTEST_STEP * np.abs(driven).max()
    risen = float(np.sum(np.diff(response.pressures)[reach]))
    name = 'filling' if sign > 0 else 'venting'
    if not sign * risen > 0:
        raise ValueError(
            f'the {name} time cannot be estimated: the pressure never '
            f'{"rises" if sign > 0 else "falls"} towards its command; step the command up and '
            'down again and record both'
        )
    return float(np.sum((driven * np.diff(response.times))[reach])) / risen
