# SPDX-License-Identifier: Apache-2.0
"""Parameters of a soft actuator from its response to steps of the commanded pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.linkage.chain import Array

_FEWEST_READINGS = 4
"""One more than there are unknowns: two time constants and the first pressure."""
_SHORTEST_STEP = 0.05
"""Distance of the pressure from its command over the largest there was: below it, the first guess
of a time constant leaves a reading out. The fit itself takes all readings."""


@dataclass(frozen=True)
class StepResponse:
    """What was recorded while the commanded pressure was stepped up and down again."""

    times: Array
    """Instants of the readings [s], shape (readings,), increasing."""
    commands: Array
    """Pressure commanded from each reading until the next [Pa], shape (readings,)."""
    pressures: Array
    """Pressure read in the chamber [Pa], shape (readings,)."""

    def __post_init__(self) -> None:
        """Refuse records that no time constants can be found in."""
        columns = (self.times, self.commands, self.pressures)
        if len({column.shape for column in columns}) != 1 or self.times.ndim != 1:
            raise ValueError('times, commands and pressures must have one shape, (readings,)')
        if len(self.times) < _FEWEST_READINGS:
            raise ValueError(
                f'a step response of {len(self.times)} readings must have {_FEWEST_READINGS} or '
                'more; read more often or for longer'
            )
        if not all(np.isfinite(column).all() for column in columns):
            raise ValueError('times, commands and pressures must be finite numbers')
        if np.any(np.diff(self.times) <= 0):
            raise ValueError('the times of a step response must increase')


@dataclass(frozen=True)
class PneumaticFit:
    """Time constants that explain a step response best."""

    filling_time: float
    """With which the pressure rises [s]."""
    venting_time: float
    """With which it falls [s]."""
    filling_deviation: float
    """Standard deviation of the filling time [s], from the residuals."""
    venting_deviation: float
    """Standard deviation of the venting time [s]."""
    residual: float
    """Root mean square of what is left unexplained [Pa]."""


def fit_step_response(response: StepResponse) -> PneumaticFit:
    """Time constants of filling and venting from steps up and steps down, by least squares.

    It starts from dp/dt = (u - p) / tau integrated over all readings in between which the
    pressure rises, tau_fill = sum (u - p) dt / sum dp, and likewise for those where it falls.
    Raises ValueError where the command never stays above or never stays below the pressure.

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
    """Torque per pressure [N m/Pa] and saturation torque [N m] of steady readings, (readings,).

    Least squares of clip(k p, -limit, limit). The limit is infinite unless it explains half of
    what a straight line leaves over: more pressure would be needed to find it.
    """
    order = np.argsort(np.abs(pressures))
    pressed, twisted = np.abs(pressures[order]), np.sign(pressures[order]) * torques[order]
    if len(pressed) < 2 or not pressed[-1] > 0:
        raise ValueError('torques must be read at two pressures or more, one of them not 0')
    # With the saturated readings known both are averages; they are the last so many.
    fits = [_split_fit(pressed, twisted, count) for count in range(1, len(pressed) + 1)]
    straight = fits[-1]
    best = min((fit for fit in fits if fit is not None), default=None)
    if straight is None or best is None:
        raise ValueError('torques must be read at pressures that are not 0')
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
    """First guess of the time constant of rises (+1) or falls (-1) [s]."""
    middle = (response.pressures[1:] + response.pressures[:-1]) / 2
    driven = response.commands[:-1] - middle
    reach = sign * driven > _SHORTEST_STEP * np.abs(driven).max()
    risen = float(np.sum(np.diff(response.pressures)[reach]))
    name = 'filling' if sign > 0 else 'venting'
    if not sign * risen > 0:
        raise ValueError(
            f'the {name} time cannot be told: the pressure never '
            f'{"rises" if sign > 0 else "falls"} towards its command; step the command up and '
            'down again and record both'
        )
    return float(np.sum((driven * np.diff(response.times))[reach])) / risen
