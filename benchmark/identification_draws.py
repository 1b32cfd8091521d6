# SPDX-License-Identifier: Apache-2.0
"""Random chains of the identification benchmark: simulated, recorded, identified and stored."""

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
"""Frame rate [Hz]."""
NOISE = 0.01
"""Standard deviation of the noise of a reading [rad]."""
OFFSET = 0.05
"""Standard deviation of the encoder offsets [rad]."""
SPREAD = 0.05
"""Relative standard deviation of lengths of one kind [1]."""
POSITIONS = 200
"""Number of frames with a measured position [1]."""
_SEEDS = 1000
"""Number of seeds per chain [1]; the first seed whose chain can be passed by a wall is used."""


@dataclass(frozen=True)
class Draw:
    """Result for one identified chain; arrays have the shape (P,) of the unknowns."""

    errors: Array
    """Errors of the logarithms of lengths [1] and of offsets [rad]."""
    linear: Array
    """First-order errors: one least-squares step from the true values with known tolerances. Their
    mean is 0, and their variance is the bound."""
    bound: Array
    """Cramer-Rao bound with known tolerances, as standard deviations."""
    alone: Array
    """Cramer-Rao bound from the angles alone."""
    stated: Array
    """Stated standard deviations."""
    position: float
    """Root mean square error of the nearest-point position, divided by its bound [1]."""


def draw_of(name: str, number: int, folder: Path) -> Draw:
    """Return the result of a chain, from its file if the file exists."""
    path = folder / f'{name}_{number:04}.npz'
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix('.part.npz')
        np.savez(partial, **asdict(made(name, number)))
        partial.rename(path)
    with np.load(path) as stored:
        values = {key: stored[key] for key in stored.files}
    return Draw(**{**values, 'position': float(values['position'])})


def chain_of(nominal: Chain, number: int) -> Chain:
    """Return a chain with random lengths, through which a wall can pass."""
    for seed in range(_SEEDS * number, _SEEDS * (number + 1)):
        spreads = dict.fromkeys(('spacing', 'rotor_length', 'rest_length'), SPREAD)
        drawn = drawn_deviations(nominal.number_of_rotors, seed, **spreads)
        if not blocked_bonds(chain := replace(nominal, deviations=drawn)).any():
            return chain
    raise RuntimeError(f'walls cannot pass any of {_SEEDS} random chains; lower SPREAD')


def passage(orbit: Orbit, speed: float) -> Array:
    """Return the angles of rigid bars during one passage of a wall [rad], shape (T, N)."""
    begin, end = orbit.leg_arcs(0)
    frames = round((end - begin) / orbit.site_arc / speed * RATE)
    return np.array([orbit.configuration(arc) for arc in np.linspace(begin, end, frames)])


def read(angles: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Return random encoder offsets [rad], (N,), and noisy readings [rad], (T, N)."""
    offsets = OFFSET * random.standard_normal(angles.shape[1])
    return offsets, angles + offsets + NOISE * random.standard_normal(angles.shape)


def made(name: str, number: int) -> Draw:
    """Draw a chain, record a passage, and identify the chain."""
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
        position=position_error(orbit, used, offsets - found.lengths.offsets, random),
    )


def position_error(true: Orbit, used: Orbit, offsets: Array, random: np.random.Generator) -> float:
    """Return the rms position error on an identified chain, divided by the bound [1].

    `offsets` are the remaining encoder offsets [rad], shape (N,).
    """
    rotors = true.chain.number_of_rotors
    squares = []
    for position in random.uniform(4, rotors - 5, POSITIONS):
        arc = true.arc_at(float(position), 0)
        noise = NOISE * random.standard_normal(rotors)
        found = fit_near(used, true.configuration(arc) + offsets + noise, used.arc_at(position, 0))
        least = NOISE / true.site_arc_at(arc)
        squares.append(((used.site(found.arc) - position) / least) ** 2)
    return math.sqrt(float(np.mean(squares)))
