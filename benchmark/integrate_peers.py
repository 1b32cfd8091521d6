# SPDX-License-Identifier: Apache-2.0
"""Methods to integrate a chain of springs: ours and those of other tools.

`prepare` sets a method up for a problem and a tolerance or step, and returns `ready`, which resets
the state and returns `run`. Only the wall time of `run` is measured; it returns the final angles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import heyoka
import mujoco
import numpy as np
from plain_chain import derivative as plain_derivative
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import SymplecticNystrom
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain

Run = Callable[[], Array]
Ready = Callable[[], Run]


@dataclass(frozen=True)
class Problem:
    """Chain at rest that is kicked at its first edge, in units of a = M = k_e = 1."""

    name: str
    rotors: int
    duration: float
    rotor_length: float
    rest_angle: float
    speed: float

    @cached_property
    def chain(self) -> Chain:
        """Chain, which initially leans left."""
        return Chain(self.rotors, 1.0, self.rotor_length, self.rest_angle, 1.0, 1.0)

    @cached_property
    def angles(self) -> Array:
        """Initial angles [rad], shape (N,)."""
        return self.chain.uniform_state(-1)

    @cached_property
    def rates(self) -> Array:
        """Initial rates after the kick [rad / time unit], shape (N,)."""
        return self.speed * edge_mode(self.chain, self.angles, Edge.FIRST)


@dataclass(frozen=True)
class Peer:
    """Method of integration, with settings from coarse to fine."""

    name: str
    prepare: Callable[[Problem, float], Ready]
    settings: tuple[float, ...]
    constant_step: bool = False
    """Whether the step is constant, so that the time is proportional to the duration."""


def symplectic(problem: Problem, tolerance: float) -> Ready:
    motion = EquationOfMotion(problem.chain)
    state = motion.state(problem.angles, problem.rates)
    absolute = tolerance / math.sqrt(len(state))

    def ready() -> Run:
        solver = SymplecticNystrom(motion, 0.0, state, problem.duration, rtol=0.0, atol=absolute)

        def run() -> Array:
            while solver.status == 'running':
                solver.step()
            return solver.y[: problem.rotors]

        return run

    ready()()
    return ready


def plain_scipy(problem: Problem, tolerance: float) -> Ready:
    """Prepare DOP853 of scipy with a right-hand side in numpy."""
    start = np.concatenate([problem.angles, problem.rates])

    def run() -> Array:
        span, rule = (0.0, problem.duration), partial(plain_derivative, problem.chain)
        limits = {'rtol': tolerance, 'atol': tolerance}
        solution = solve_ivp(lambda _, state: rule(state), span, start, method='DOP853', **limits)
        return solution.y[: problem.rotors, -1]

    return lambda: run


def heyoka_taylor(problem: Problem, tolerance: float) -> Ready:
    """Prepare heyoka; long chains use the compact mode to limit compilation time."""
    number, chain = problem.rotors, problem.chain
    a, r, rest_length = chain.spacing, chain.rotor_length, chain.rest_length
    angles = [heyoka.make_vars(f'angle_{n}') for n in range(number)]
    rates = [heyoka.make_vars(f'rate_{n}') for n in range(number)]
    sines, cosines = [heyoka.sin(x) for x in angles], [heyoka.cos(x) for x in angles]
    terms: list[list[object]] = [[] for _ in range(number)]
    for n in range(number - 1):
        s, c, s_next, c_next = sines[n], cosines[n], sines[n + 1], cosines[n + 1]
        square = (
            (a**2 + 2 * r**2) + 2 * a * r * (s_next - s) - 2 * r**2 * (s * s_next + c * c_next)
        )
        tension = 1.0 - rest_length * square**-0.5
        cross = s * c_next - c * s_next
        terms[n].append(tension * ((a / r) * c - cross))
        terms[n + 1].append(tension * (cross - (a / r) * c_next))
    system = list(zip(angles, rates, strict=True))
    system += [(rate, heyoka.sum(term)) for rate, term in zip(rates, terms, strict=True)]
    start = np.concatenate([problem.angles, problem.rates])
    integrator = heyoka.taylor_adaptive(system, start, tol=tolerance, compact_mode=number > 20)

    def run() -> Array:
        integrator.propagate_until(problem.duration)
        return integrator.state[:number].copy()

    def ready() -> Run:
        integrator.time = 0.0
        integrator.state[:] = start
        return run

    return ready


def mujoco_with(integrator: str, problem: Problem, step: float) -> Ready:
    model = mujoco_model(problem.chain, integrator)
    data = mujoco.MjData(model)
    count = math.ceil(problem.duration / step)
    model.opt.timestep = problem.duration / count

    def run() -> Array:
        mujoco.mj_step(model, data, nstep=count)
        return data.qpos.copy()

    def ready() -> Run:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = problem.angles, problem.rates
        return run

    return ready


@lru_cache(maxsize=2)
def mujoco_model(chain: Chain, integrator: str) -> mujoco.MjModel:
    r, number = chain.rotor_length, chain.number_of_rotors
    bodies = ''.join(
        f'<body pos="{n * chain.spacing} 0 0"><joint type="hinge" axis="0 1 0"/>'
        f'<inertial pos="0 0 {r}" mass="{chain.mass}" diaginertia="1e-14 1e-14 1e-14"/>'
        f'<site name="{n}" pos="0 0 {r}"/></body>'
        for n in range(number)
    )
    springs = ''.join(
        f'<spatial stiffness="{chain.stiffness}" springlength="{chain.rest_length!r}">'
        f'<site site="{n}"/><site site="{n + 1}"/></spatial>'
        for n in range(number - 1)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option integrator="{integrator}" gravity="0 0 0" jacobian="sparse">'
        '<flag contact="disable" constraint="disable"/></option>'
        f'<worldbody>{bodies}</worldbody><tendon>{springs}</tendon></mujoco>'
    )


OURS = Peer('ours', symplectic, tuple(10.0**-n for n in range(4, 12)))
PEERS = (
    Peer('heyoka', heyoka_taylor, (1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    Peer('MuJoCo RK4', partial(mujoco_with, 'RK4'), (0.2, 0.1, 0.05, 0.025, 0.0125), True),
    Peer('MuJoCo implicitfast', partial(mujoco_with, 'implicitfast'), (0.1, 0.02, 0.005), True),
    Peer('scipy DOP853', plain_scipy, tuple(10.0**-n for n in range(4, 13))),
)
