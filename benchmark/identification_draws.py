# SPDX-License-Identifier: Apache-2.0
"""Chains of the benchmark of the identification: made, recorded, identified, kept in files."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from soliton_linkage.estimation.relocalisation import fit_near
from soliton_linkage.identification.adjustment import adjust, cramer_rao_bound
from soliton_linkage.identification.bundle import Bundle
from soliton_linkage.identification.lengths import (
    Tolerances,
    chain_lengths,
    initial_lengths,
    to_unknowns,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.passage import blocked_bonds

CHAINS = {
    'flipper': (Chain(40, 0.1, 0.05, 0.97), 9.7),
    'wobbler': (Chain(40, 0.1, 0.1, 0.77), 3.4),
    'spinner': (Chain(40, 0.1, 0.2, 1.18), 6.9),
}
"""Chains and the speeds of their walls [rotor spacings / s]."""
RATE = 250.0
"""Of frames [Hz]."""
NOISE = 0.01
"""Of a reading [rad]."""
OFFSET = 0.05
"""Standard deviation of an encoder's zero [rad]."""
SPREAD = 0.05
"""Of lengths of one kind [1]."""
PLACES = 200
"""Frames on which the place is measured [1]."""
_SEEDS = 1000
"""Between the seeds of two chains [1], of which the first that lets walls pass is taken."""


@dataclass(frozen=True)
class Draw:
    """A chain that was identified; arrays have the shape (P,) of the unknowns."""

    errors: Array
    """Of the identified chain: of logarithms of lengths [1] and of offsets [rad]."""
    linear: Array
    """The same of one step of least squares from the truth, with the tolerances known: to first
    order the best that can be, without bias, of the variance of the bound."""
    bound: Array
    """Cramer-Rao bound with the tolerances known, as standard deviations."""
    alone: Array
    """The same by the angles alone."""
    stated: Array
    """Standard deviations that were stated."""
    place: float
    """Root mean square error of the place by the nearest point, over its bound [1]."""


def draw_of(name: str, number: int, folder: Path) -> Draw:
    """A chain of a class, from its file where it has one."""
    path = folder / f'{name}_{number:04}.npz'
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix('.part.npz')
        np.savez(partial, **asdict(made(name, number)))
        partial.rename(path)
    with np.load(path) as stored:
        values = {key: stored[key] for key in stored.files}
    return Draw(**{**values, 'place': float(values['place'])})


def chain_of(nominal: Chain, number: int) -> Chain:
    """Chain with lengths of its own that lets walls pass."""
    for seed in range(_SEEDS * number, _SEEDS * (number + 1)):
        spreads = dict.fromkeys(('spacing', 'rotor_length', 'rest_length'), SPREAD)
        drawn = drawn_deviations(nominal.number_of_rotors, seed, **spreads)
        if not blocked_bonds(chain := replace(nominal, deviations=drawn)).any():
            return chain
    raise RuntimeError(f'none of {_SEEDS} chains lets walls pass')


def passage(orbit: Orbit, speed: float) -> Array:
    """Angles of rigid bars along which a wall passes once [rad], shape (T, N)."""
    begin, end = orbit.leg_arcs(0)
    frames = round((end - begin) / orbit.site_arc / speed * RATE)
    return np.array([orbit.configuration(arc) for arc in np.linspace(begin, end, frames)])


def read(angles: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Offsets of encoders [rad], shape (N,), and what they read with noise, shape (T, N)."""
    offsets = OFFSET * random.standard_normal(angles.shape[1])
    return offsets, angles + offsets + NOISE * random.standard_normal(angles.shape)


def made(name: str, number: int) -> Draw:
    """Make a chain, record a passage, and identify it."""
    nominal, speed = CHAINS[name]
    chain = chain_of(nominal, number)
    random = np.random.default_rng([number, 7])
    orbit = orbit_of(chain)
    angles = passage(orbit, speed)
    offsets, readings = read(angles, random)
    found = adjust(readings, initial_lengths(readings))
    true = replace(chain_lengths(chain).scaled(1.0), offsets=offsets)
    tolerances = Tolerances(SPREAD, OFFSET)
    known = cramer_rao_bound(chain, angles, NOISE, tolerances)
    bundle = Bundle(true, readings)
    bundle.angles = angles.T.copy()
    prior = tolerances.information(nominal.number_of_rotors)
    gradient = bundle.normal_equations().vector / NOISE**2 - prior @ to_unknowns(true)
    used = orbit_of(found.lengths.scaled(float(chain.spacings.mean())).chain(nominal))
    return Draw(
        errors=to_unknowns(found.lengths.scaled(1.0)) - to_unknowns(true),
        linear=known @ gradient,
        bound=np.sqrt(np.diag(known)),
        alone=np.sqrt(np.diag(cramer_rao_bound(chain, angles, NOISE))),
        stated=found.deviations,
        place=place_error(orbit, used, offsets - found.lengths.offsets, random),
    )


def place_error(true: Orbit, used: Orbit, offsets: Array, random: np.random.Generator) -> float:
    """Root mean square error of the place over its bound, on a chain used for the true one.

    Offsets are what is left of the encoders' zeros [rad], shape (N,).
    """
    rotors = true.chain.number_of_rotors
    squares = []
    for place in random.uniform(4, rotors - 5, PLACES):
        arc = true.arc_at(float(place), 0)
        noise = NOISE * random.standard_normal(rotors)
        found = fit_near(used, true.configuration(arc) + offsets + noise, used.arc_at(place, 0))
        least = NOISE / true.site_arc_at(arc)
        squares.append(((used.site(found.arc) - place) / least) ** 2)
    return math.sqrt(float(np.mean(squares)))
