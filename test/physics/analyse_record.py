# SPDX-License-Identifier: Apache-2.0
"""Print the analyses of a short noisy record as JSON, and whether loops are compiled."""

import dataclasses
import enum
import json
from numbers import Real

import numba
import numpy as np

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

FRAMES = 60


def record(chain: Chain) -> list[tuple[int, Array, Array]]:
    """Frames of a wall that is kicked half way, some with a rotor that is not seen."""
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


def main() -> None:
    """Analyse the record of a wobbling flipper."""
    chain = Chain(number_of_rotors=10, rotor_length=0.1, rest_angle=0.77)
    analyser = Analyser(chain)
    said = [numbers(analyser.analyse(*frame)) for frame in record(chain)]
    print(json.dumps({'compiled': not numba.config.DISABLE_JIT, 'said': said}))


if __name__ == '__main__':
    main()
