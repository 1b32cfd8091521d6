# SPDX-License-Identifier: Apache-2.0
"""Processor time to move many disordered chains, for `simulate_many` and for other tools.

Kicked flippers (r/a = 0.5, theta_bar = 0.97, edge kick of 0.1) with random lengths and distances
move for 200 units of time. The tolerance of a method is the coarsest one at which the angles of
the first chains differ by at most 1e-5 rad from the angles of our solver at a tolerance of 1e-11.
Processor time counts all threads, so that ratios within a round are ratios of the throughputs per
core. Compilation is not included.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from comparison import Comparison, Figure, Part, parse, parser, write

from soliton_linkage.dynamics.ensemble import simulate_many
from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import State, leaning
from soliton_linkage.dynamics.integrators import SymplecticNystrom
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Disorder
from soliton_linkage.progress import ProgressLine

DURATION = 200.0
TARGET = 1e-5
CHECKED = 32
DISORDER = 0.01
TOLERANCES = tuple(10.0**-n for n in range(2, 11))

Chains = list[tuple[Chain, State]]
Method = Callable[[Chains, float], Array]
"""Function that returns the last angles, (chains, N), for chains and a tolerance."""


def ours(chains: Chains, tolerance: float) -> Array:
    pairs = zip(*chains, strict=True)
    return np.array(list(simulate_many(*pairs, DURATION, tolerance=tolerance)))[:, 0]


def one_by_one(chains: Chains, tolerance: float) -> Array:
    found = []
    for chain, start in chains:
        motion = EquationOfMotion(chain)
        state = motion.state(start.angles, start.rates)
        atol = tolerance / np.sqrt(len(state))
        solver = SymplecticNystrom(motion, 0.0, state, DURATION, rtol=0.0, atol=atol)
        while solver.status == 'running':
            solver.step()
        found.append(solver.y[: motion.rotors])
    return np.array(found)


def parameters(chain: Chain) -> Array:
    """Return the parameters of the springs and rotors, shape (P,), see `torque_law`."""
    left, right = chain.rotor_lengths[:-1], chain.rotor_lengths[1:]
    a, inertia = chain.spacings, chain.moments_of_inertia
    lengths = a**2 + left**2 + right**2, 2 * a * right, 2 * a * left, 2 * left * right
    first, second = chain.stiffnesses / inertia[:-1], chain.stiffnesses / inertia[1:]
    levers = first * a * left, first * left * right, second * a * right, second * left * right
    return np.concatenate([*lengths, chain.rest_lengths, *levers])


def heyoka_batch(rotors: int) -> Method:
    import heyoka

    q = [heyoka.make_vars(f'q{n}') for n in range(rotors)]
    w = [heyoka.make_vars(f'w{n}') for n in range(rotors)]
    sines, cosines = [heyoka.sin(x) for x in q], [heyoka.cos(x) for x in q]
    terms: list[list[Any]] = [[] for _ in range(rotors)]
    bonds = rotors - 1
    for n in range(bonds):
        p = [heyoka.par[k * bonds + n] for k in range(9)]
        s, c, s_next, c_next = sines[n], cosines[n], sines[n + 1], cosines[n + 1]
        square = p[0] + p[1] * s_next - p[2] * s - p[3] * (s * s_next + c * c_next)
        tension = 1.0 - p[4] * square**-0.5
        cross = s * c_next - c * s_next
        terms[n].append(tension * (p[5] * c - p[6] * cross))
        terms[n + 1].append(tension * (p[8] * cross - p[7] * c_next))
    system = list(zip(q, w, strict=True))
    system += [(rate, heyoka.sum(term)) for rate, term in zip(w, terms, strict=True)]
    size = heyoka.recommended_simd_size()
    integrators: dict[float, Any] = {}

    def integrate(chains: Chains, tolerance: float) -> Array:
        if tolerance not in integrators:
            start, pars = np.zeros((2 * rotors, size)), np.zeros((9 * bonds, size))
            how = {'tol': tolerance, 'pars': pars, 'compact_mode': rotors > 20}
            integrators[tolerance] = heyoka.taylor_adaptive_batch(system, start, **how)
        found, batch = [], integrators[tolerance]
        for first in range(0, len(chains), size):
            part = chains[first : first + size]
            filled = part + [part[-1]] * (size - len(part))
            batch.set_time(0.0)
            batch.pars[:] = np.transpose([parameters(chain) for chain, _ in filled])
            batch.state[:] = np.transpose([[*s.angles, *s.rates] for _, s in filled])
            batch.propagate_until(DURATION)
            found.append(batch.state[:rotors, : len(part)].T.copy())
        return np.concatenate(found)

    return integrate


def diffrax_vmap(rotors: int) -> Method:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update('jax_enable_x64', True)

    def derivative(_time: Any, state: Any, given: Any) -> Any:
        p = given.reshape(9, rotors - 1)
        q, w = state[:rotors], state[rotors:]
        s, c = jnp.sin(q), jnp.cos(q)
        square = p[0] + p[1] * s[1:] - p[2] * s[:-1] - p[3] * (s[:-1] * s[1:] + c[:-1] * c[1:])
        tension = 1 - p[4] / jnp.sqrt(square)
        cross = s[:-1] * c[1:] - c[:-1] * s[1:]
        torques = jnp.zeros(rotors).at[:-1].add(tension * (p[5] * c[:-1] - p[6] * cross))
        return jnp.concatenate([w, torques.at[1:].add(tension * (p[8] * cross - p[7] * c[1:]))])

    def last(state: Any, given: Any, tolerance: Any) -> Any:
        rule, control = (
            diffrax.ODETerm(derivative),
            diffrax.PIDController(rtol=tolerance, atol=tolerance),
        )
        problem = rule, diffrax.Dopri8(), 0.0, DURATION, None, state, given
        solution = diffrax.diffeqsolve(*problem, stepsize_controller=control, max_steps=None)
        return solution.ys[-1, :rotors]

    mapped = jax.jit(jax.vmap(last, in_axes=(0, 0, None)))

    def integrate(chains: Chains, tolerance: float) -> Array:
        states = np.array([[*start.angles, *start.rates] for _, start in chains])
        given = np.array([parameters(chain) for chain, _ in chains])
        return np.asarray(mapped(states, given, tolerance))

    return integrate


OURS, ALONE = 'ours', 'ours, one chain at a time'
PEERS = {'heyoka batch': ('heyoka', heyoka_batch), 'diffrax vmap': ('diffrax', diffrax_vmap)}


def methods(rotors: int) -> dict[str, Method]:
    """Return our methods and the methods of the installed peers."""
    found: dict[str, Method] = {OURS: ours, ALONE: one_by_one}
    for name, (package, prepare) in PEERS.items():
        try:
            found[name] = prepare(rotors)
        except ImportError as error:
            print(f'{name} is skipped: pip install {package} ({error})', file=sys.stderr)
    return found


def disordered(rotors: int, count: int) -> Chains:
    found = []
    for seed in range(count):
        spread = Disorder(rotor_length=DISORDER, spacing=DISORDER, seed=seed)
        chain = Chain(rotors, 1.0, 0.5, 0.97, 1.0, 1.0, deviations=spread.drawn(rotors))
        angles = leaning(chain, -1).angles
        found.append((chain, State(angles, 0.1 * edge_mode(chain, angles, Edge.FIRST))))
    return found


def fresh(chains: Iterable[tuple[Chain, State]]) -> Chains:
    """Return copies of the chains without the cached arrays of earlier runs."""
    return [(replace(chain), start) for chain, start in chains]


def measure(rotors: int, count: int, rounds: int) -> tuple[list[Comparison], list[Figure]]:
    chains, found = disordered(rotors, count), methods(rotors)
    progress = ProgressLine(f'{rotors} rotors', len(found) + rounds)
    few = chains[:CHECKED]
    reference = one_by_one(few, 1e-11)
    chosen = {}
    for done, (name, method) in enumerate(found.items()):
        progress.show(done, name)
        errors = ((each, np.abs(method(few, each) - reference).max()) for each in TOLERANCES)
        chosen[name] = next(each for each, error in errors if error < TARGET)
        method(chains, chosen[name])
    times: dict[str, list[float]] = {name: [] for name in found}
    walls = []
    for turn in range(rounds):
        progress.show(len(found) + turn, f'round {turn + 1} of {rounds}')
        for name, method in found.items():
            given = fresh(chains)
            start, wall = time.process_time(), time.perf_counter()
            method(given, chosen[name])
            times[name].append((time.process_time() - start) / count)
            if name == OURS:
                walls.append((time.perf_counter() - wall) / count)
    progress.end(f'chains of {rotors} rotors measured')
    work = f'{count} chains of {rotors}, error {TARGET:g} rad, per chain and core'
    comparisons = [Comparison(n, work, 's', times[n], times[OURS]) for n in times if n != OURS]
    cores = [t / w for t, w in zip(times[OURS], walls, strict=True)]
    what = f'cores in use, {rotors} rotors, of {os.cpu_count()}'
    return comparisons, [Figure(what, '', cores)]


def main() -> None:
    made = parser(__doc__)
    made.add_argument('--rotors', type=int, nargs='*', default=[20, 40])
    made.add_argument('--chains', type=int, help='(1000; quick: 40)')
    options = parse(made, chains=(40, 1000), rounds=(2, 5))
    parts = [measure(rotors, options.chains, options.rounds) for rotors in options.rotors]
    comparisons = [each for found, _ in parts for each in found]
    figures = [each for _, found in parts for each in found]
    write(Part('ensemble', comparisons, figures), options.output)


if __name__ == '__main__':
    main()
