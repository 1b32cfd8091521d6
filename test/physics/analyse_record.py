# SPDX-License-Identifier: Apache-2.0
"""Print analyses of a short noisy record, the end of a simulation, and whether it is compiled."""

import dataclasses
import enum
import json
from numbers import Real

import numba
import numpy as np

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

FRAMES = 60


def record(chain: Chain) -> list[tuple[int, Array, Array]]:
    orbit, random = UniformOrbit(chain), np.random.default_rng(3)
    rotors, arc, frames = chain.number_of_rotors, orbit.arc_at(2.0, 0), []
    for number in range(FRAMES):
        arc += 0.02 if number < FRAMES // 2 else 0.05
        angles = orbit.configuration(arc) + 0.01 * random.standard_normal(rotors)
        if number % 10 == 5:
            angles[3] = np.nan
        frames.append((4_000_000 * number, angles, 0.1 * random.standard_normal(rotors)))
    return frames


def numbers(value: object) -> list[float | str | None]:
    """Return all values of an analysis."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = [getattr(value, each.name) for each in dataclasses.fields(value)]
        return [number for part in parts for number in numbers(part)]
    if isinstance(value, tuple):
        return [number for part in value for number in numbers(part)]
    if isinstance(value, enum.Enum):
        return [value.name]
    return [float(value) if isinstance(value, Real | np.bool_) else None]


def moved(damping: float) -> list[list[float]]:
    """Return angles and rates of a chain after 6 time units."""
    chain = Chain(6, damping=damping)
    angles, unit = chain.uniform_state(-1), chain.time_unit
    rates = 0.2 / unit * edge_mode(chain, angles, Edge.FIRST)
    end = simulate(chain, angles, rates, 6 * unit, unit, 1e-6)
    return [end.angles[-1].tolist(), (unit * end.rates[-1]).tolist()]


def main() -> None:
    chain = Chain(number_of_rotors=10, rotor_length=0.1, rest_angle=0.77)
    analyser = Analyser(chain)
    said = [numbers(analyser.analyse(*frame)) for frame in record(chain)]
    ends = [moved(0.0), moved(1e-5)]
    print(json.dumps({'compiled': not numba.config.DISABLE_JIT, 'said': said, 'moved': ends}))


if __name__ == '__main__':
    main()
