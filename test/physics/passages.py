# SPDX-License-Identifier: Apache-2.0
"""Chains whose lengths all differ, and frames of a wall that passes along them."""

from dataclasses import replace

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.solitons.passage import blocked_bonds

FLIPPER = Chain(10, 0.1, 0.05, 0.97)
WOBBLER = Chain(10, 0.1, 0.1, 0.77)
SPINNER = Chain(10, 0.1, 0.2, 1.18)
NAMES = tuple(f'rotor_{n}' for n in range(10))


def unequal(chain: Chain, seed: int, spread: float = 0.05) -> Chain:
    """Chain with lengths of its own, the first drawn that lets walls pass."""
    while True:
        drawn = drawn_deviations(
            chain.number_of_rotors, seed, spacing=spread, rotor_length=spread, rest_length=spread
        )
        made = replace(chain, deviations=drawn)
        if not blocked_bonds(made).any():
            return made
        seed += 1000


def passage(chain: Chain, frames: int = 500) -> Array:
    """Angles of rigid bars along which a wall passes from edge to edge [rad], shape (T, N)."""
    orbit = orbit_of(chain)
    return np.array([orbit.configuration(arc) for arc in np.linspace(*orbit.leg_arcs(0), frames)])


def read(
    angles: Array, seed: int, noise: float = 0.01, offset: float = 0.05
) -> tuple[Array, Array]:
    """Readings of encoders [rad], shape (T, N), and their offsets, shape (N,)."""
    random = np.random.default_rng(seed)
    offsets = offset * random.standard_normal(angles.shape[1])
    return angles + offsets + noise * random.standard_normal(angles.shape), offsets
