# SPDX-License-Identifier: Apache-2.0
"""Chains whose rotors and springs all differ, with free or periodic ends, and their bare twin."""

import dataclasses
import math

import numpy as np
from chains import EPS, any_angles, any_chain
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations


def random_deviations(rotors: int, springs: int, seed: int, largest: float) -> Deviations:
    """Draw fractions of every quantity, evenly from -largest to +largest."""
    random = np.random.default_rng(seed)

    def some(count: int) -> tuple[float, ...]:
        return tuple(random.uniform(-largest, largest, count).tolist())

    return Deviations(
        spacing=some(springs),
        rotor_length=some(rotors),
        mass=some(rotors),
        stiffness=some(springs),
        rest_length=some(springs),
        damping=some(rotors),
    )


def deviating(chain: Chain, seed: int, largest: float) -> Chain:
    """Return the chain with deviations of every quantity up to the largest."""
    rotors, springs = chain.number_of_rotors, chain.number_of_springs
    drawn = random_deviations(rotors, springs, seed, largest)
    return dataclasses.replace(chain, deviations=drawn)


@st.composite
def any_deviating_chain(
    draw: st.DrawFn, fewest: int = 2, most: int = 9, largest: float = 0.3
) -> Chain:
    """Draw a chain of either ends, with a damping, in which everything deviates."""
    chain = draw(any_chain(fewest, most))
    strong = 10 * chain.moment_of_inertia / chain.time_unit
    damping = draw(st.floats(0, min(strong, 1e6)))
    if draw(st.booleans()):
        rotors = 2 * ((chain.number_of_rotors + 1) // 2)
        chain = dataclasses.replace(chain, number_of_rotors=rotors, periodic=True)
    chain = dataclasses.replace(chain, damping=damping)
    return deviating(chain, draw(st.integers(0, 2**32)), draw(st.floats(0, largest)))


@st.composite
def any_deviating_configuration(
    draw: st.DrawFn, fewest: int = 2, most: int = 9
) -> tuple[Chain, Array]:
    chain = draw(any_deviating_chain(fewest, most))
    return chain, draw(any_angles(chain))


def bare_springs(chain: Chain, angles: Array) -> tuple[Array, Array, Array]:
    """Extensions [m] and levers [m/rad] of the springs, one at a time, each (springs,).

    A lever is the part along the spring of the way that a mass goes in a radian.
    """
    rows = []
    for n in range(chain.number_of_springs):
        after = (n + 1) % chain.number_of_rotors
        r, r_after = chain.rotor_lengths[n], chain.rotor_lengths[after]
        across = chain.spacings[n] + r_after * math.sin(angles[after]) - r * math.sin(angles[n])
        up = r_after * math.cos(angles[after]) - r * math.cos(angles[n])
        length = math.hypot(across, up)
        way = r * math.cos(angles[n]), -r * math.sin(angles[n])
        way_after = r_after * math.cos(angles[after]), -r_after * math.sin(angles[after])
        rows.append(
            (
                length - chain.rest_lengths[n],
                -(across * way[0] + up * way[1]) / length,
                (across * way_after[0] + up * way_after[1]) / length,
            )
        )
    extensions, first, second = np.array(rows).T
    return extensions, first, second


def reach(chain: Chain) -> float:
    """Longest that a spring of the chain can be, or is at rest [m]."""
    longest = float(chain.spacings.max() + 2 * chain.rotor_lengths.max())
    return max(longest, float(chain.rest_lengths.max()))


def rounding(chain: Chain) -> float:
    """Rounding error of an extension [m], e_n / (l_n + lbar_n) with l_n + lbar_n >= lbar_n.

    The dozen terms of e_n are each at most the squared reach. Half of them cancel in pairs, except
    for the deviations. Each is rounded up to four times by EPS / 2 of its size.
    """
    return 12 * 2 * EPS * reach(chain) ** 2 / float(chain.rest_lengths.min())


def shortest_length(chain: Chain, angles: Array) -> float:
    """Length of the shortest spring of a configuration [m]."""
    return float((bare_springs(chain, angles)[0] + chain.rest_lengths).min())
