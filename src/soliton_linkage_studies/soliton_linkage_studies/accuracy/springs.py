# SPDX-License-Identifier: Apache-2.0
"""Second integrator of elastic chains; it shares only the spring geometry with the simulator.

A step of length h is Suzuki's symplectic composition of five leapfrog steps, of order 4. With
angles x, rates v, torques F and moments of inertia I, the leapfrog steps are

    x += w h v / 2,  v += w h F(x) / I,  x += w h v / 2  for w = p, p, 1 - 4 p, p, p,

with p = 1 / (4 - 4^(1/3)). The time unit is `Chain.time_unit`, sqrt(M / k_e).
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import compile_loop, compiled, const_f8_1d, const_f8_2d, f8_1d, i8
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.terms import of_chain
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.linkage.springs import spring_between

_spring = compile_loop(spring_between, inlined=True)

_STEP = 0.1
"""Largest step [time units]. The relative change of the energy of a wall is then below 1e-6, for
speeds up to 0.9 times the speed of sound."""
_TOLERANCE = 1e-8
"""Largest integration error of an angle per step of `ForcedSprings` [rad], far below the noise."""
_SHARE = 1 / (4 - 4 ** (1 / 3))
"""Weight p of a leapfrog step [1]."""
_WEIGHTS = np.array([_SHARE, _SHARE, 1 - 4 * _SHARE, _SHARE, _SHARE])
"""Weights of the five leapfrog steps, relative to the whole step [1]."""


class Springs:
    """Simulation of an elastic chain, frame by frame.

    The arguments are the chain, its initial angles [rad] and rates [rad/s], shape (N,) each, and
    the frame period [s].
    """

    def __init__(self, chain: Chain, angles: Array, rates: Array, period: float) -> None:
        self.chain, self.period = chain, period
        self.angles, self.rates = angles.copy(), rates.copy()
        self._steps = math.ceil(period / (_STEP * chain.time_unit))
        self._bonds = np.ascontiguousarray(
            np.stack([chain.spacings, chain.offsets, chain.rest_lengths, chain.stiffnesses])
        )
        self._lengths, self._inertias = chain.rotor_lengths, chain.moments_of_inertia

    def advance(self, damping: Array | None = None) -> None:
        """Advance by one frame period; `damping` contains the decay rates [1/s], shape (N,)."""
        step = self.period / self._steps
        kept = np.ones(len(self.angles)) if damping is None else np.exp(-damping * step)
        given = (self._lengths, self._inertias, self._bonds, kept)
        _advance(self.angles, self.rates, *given, _WEIGHTS * step, self._steps)

    def record(self, frames: int) -> Recording:
        """Record `frames` frames, beginning with the current state."""
        angles = np.empty((frames, len(self.angles)))
        rates = np.empty_like(angles)
        for frame in range(frames):
            if frame:
                self.advance()
            angles[frame], rates[frame] = self.angles, self.rates
        times = np.asarray(self.period * np.arange(frames), dtype=np.float64)
        return Recording(times, angles, rates)


class ForcedSprings(Springs):
    """Simulation of a chain with force terms by `ElasticSimulation`.

    Force terms are the torques of the chain other than the spring torques, such as damping,
    friction, motors or feedback. The integrator of this module does not contain them.
    """

    def __init__(self, chain: Chain, angles: Array, rates: Array, period: float) -> None:
        super().__init__(chain, angles, rates, period)
        self._simulation = ElasticSimulation(chain, angles, rates, period, tolerance=_TOLERANCE)

    def advance(self, damping: Array | None = None) -> None:
        """Advance by one frame period.

        A change of the attribute `rates` by the caller acts as an impulse. `damping` must be None,
        because `Chain.damping` is simulated instead.
        """
        assert damping is None
        simulation = self._simulation
        simulation.kick(self._inertias * (self.rates - simulation.rates))
        simulation.advance()
        self.angles, self.rates = simulation.angles.copy(), simulation.rates.copy()


def springs_of(chain: Chain, angles: Array, rates: Array, period: float) -> Springs:
    """Return `ForcedSprings` for a chain with force terms, otherwise `Springs`."""
    forced = of_chain(chain) or chain.feedback.acts
    return (ForcedSprings if forced else Springs)(chain, angles, rates, period)


@compiled(const_f8_1d, const_f8_1d, const_f8_2d, f8_1d)
def _pull(angles: Array, lengths: Array, bonds: Array, torques: Array) -> None:
    torques[:] = 0.0
    right, up = lengths[0] * math.sin(angles[0]), lengths[0] * math.cos(angles[0])
    for n in range(len(angles) - 1):
        right_next = lengths[n + 1] * math.sin(angles[n + 1])
        up_next = lengths[n + 1] * math.cos(angles[n + 1])
        extension, left_lever, right_lever = _spring(
            right, up, right_next, up_next, bonds[0, n], bonds[1, n], bonds[2, n]
        )
        torques[n] -= bonds[3, n] * extension * left_lever
        torques[n + 1] -= bonds[3, n] * extension * right_lever
        right, up = right_next, up_next


@compiled(f8_1d, f8_1d, const_f8_1d, const_f8_1d, const_f8_2d, const_f8_1d, const_f8_1d, i8)
def _advance(
    angles: Array,
    rates: Array,
    lengths: Array,
    inertias: Array,
    bonds: Array,
    kept: Array,
    steps: Array,
    count: int,
) -> None:
    torques = np.empty(len(angles))
    for _ in range(count):
        for step in steps:
            angles += 0.5 * step * rates
            _pull(angles, lengths, bonds, torques)
            rates += step * torques / inertias
            angles += 0.5 * step * rates
        rates *= kept
