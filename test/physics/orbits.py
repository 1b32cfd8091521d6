# SPDX-License-Identifier: Apache-2.0
"""Orbits of example chains, computed once for all tests of orbits."""

import dataclasses
from functools import lru_cache

import numpy as np
from chains import chain_of

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

Example = tuple[float, float]
LENGTHS = ('rotor_length', 'spacing', 'rest_length')
ACCURACY_UNIFORM, ACCURACY_DEVIATING = 1e-6, 1e-8
"""Accuracy of angles [rad]: splines, and Chebyshev series whose tails are cut."""


def deviating_chain(example: Example, rotors: int, fraction: float = 0.05, seed: int = 0) -> Chain:
    drawn = drawn_deviations(rotors, seed, **dict.fromkeys((*LENGTHS, 'mass'), fraction))
    return dataclasses.replace(chain_of(example, rotors), deviations=drawn)


@lru_cache(maxsize=64)
def deviating_orbit(
    example: Example, rotors: int = 20, fraction: float = 0.05, seed: int = 0
) -> DeviatingOrbit:
    return DeviatingOrbit(deviating_chain(example, rotors, fraction, seed))


@lru_cache(maxsize=128)
def uniform_orbit(example: Example, rotors: int = 20) -> UniformOrbit:
    return UniformOrbit(chain_of(example, rotors))


def accuracy(orbit: Orbit) -> float:
    return ACCURACY_UNIFORM if isinstance(orbit, UniformOrbit) else ACCURACY_DEVIATING


def some_arcs(orbit: Orbit, count: int) -> list[float]:
    """Arcs on the whole orbit, beyond both ends, and near every reflection."""
    even = np.linspace(-1, orbit.length + 1, count)
    begins = [orbit.leg_arcs(leg)[0] for leg in range(orbit.number_of_legs)]
    return [*even.tolist(), *(begin + by for begin in begins for by in (-0.3, 0.0, 0.4))]
