# SPDX-License-Identifier: Apache-2.0
"""Chains to state laws for: an example of each class of motion, and any chain at all."""

import math

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from soliton_linkage.linkage.chain import Array, Chain

EPS = float(np.finfo(np.float64).eps)

# Ratio r / a and rest angle of chains whose numbers stand in the literature (docs/physics.md).
FLIPPER = (0.5, 0.97)
WIDE_FLIPPER = (0.5, 0.3)
WOBBLER = (1.0, 0.77)
STRONG_WOBBLER = (1.45, 0.77)
SPINNER = (2.0, 1.18)
WIDE_SPINNER = (4.0, 0.9)
# One of each class of motion, the one that asks most of a law.
EXAMPLES = (WIDE_FLIPPER, STRONG_WOBBLER, WIDE_SPINNER)
CLASSES = (FLIPPER, WOBBLER, SPINNER)


def chain_of(example: tuple[float, float], rotors: int) -> Chain:
    """Return a chain with the given r / a and rest angle [rad], its spacing 0.1 m."""
    ratio, rest_angle = example
    return Chain(rotors, spacing=0.1, rotor_length=0.1 * ratio, rest_angle=rest_angle)


@st.composite
def any_chain(draw: st.DrawFn, fewest: int = 2, most: int = 9) -> Chain:
    """Draw a chain with r / a from 0.02 to 20, of any size, mass and stiffness."""
    spacing = 10 ** draw(st.floats(-3, 1))
    ratio = math.exp(draw(st.floats(math.log(0.02), math.log(20))))
    return Chain(
        number_of_rotors=draw(st.integers(fewest, most)),
        spacing=spacing,
        rotor_length=ratio * spacing,
        rest_angle=draw(st.floats(0.01, 1.56)),
        mass=10 ** draw(st.floats(-4, 2)),
        stiffness=10 ** draw(st.floats(-1, 6)),
    )


def any_angles(chain: Chain) -> st.SearchStrategy[Array]:
    """Draw any configuration of a chain, turned by up to a turn and a half [rad]."""
    return arrays(np.float64, chain.number_of_rotors, elements=st.floats(-9, 9))


@st.composite
def any_configuration(draw: st.DrawFn, fewest: int = 2, most: int = 9) -> tuple[Chain, Array]:
    chain = draw(any_chain(fewest, most))
    return chain, draw(any_angles(chain))
