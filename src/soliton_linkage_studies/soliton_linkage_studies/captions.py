# SPDX-License-Identifier: Apache-2.0
"""How chains are called in pictures and tables."""

from __future__ import annotations

from soliton_linkage.linkage.chain import Chain

LINKAGE = (
    'Black crosses are the pivots, black bars the rotors - every other one grey where they reach '
    'over their neighbours -, blue dots the masses at their ends; r is the length of a rotor, a '
    'the distance of the pivots, θ̄ the angle of rest, d = 2 r sin θ̄ / a.'
)
"""Symbols of pictures of a chain."""
MODE = 'green arrows are the velocities of the masses in it, to one scale'
"""Symbols of a zero mode."""
PROJECTIONS = (
    'Arrows beneath the pivots are the horizontal displacements u = r sin φ of the masses, in '
    'rows where they would hide each other: purple ones lean right, orange ones left, the paler '
    'the less they lean.'
)
"""Symbols of projections."""


def parameters(chain: Chain) -> str:
    """Length of the rotors and rest angle: what the shape of a chain is."""
    return f'r/a = {chain.rotor_length / chain.spacing:g}, θ̄ = {chain.rest_angle:g}'


def shape(chain: Chain) -> str:
    """Parameters of a chain with its lean ratio d."""
    return f'{parameters(chain)}, d = {chain.lean_ratio:.2f}'


def class_and_shape(chain: Chain) -> str:
    """Class of a chain and its parameters r/a and theta_bar, as tables have them."""
    ratio = chain.rotor_length / chain.spacing
    return f'{chain.motion.value} ({ratio:g}, {chain.rest_angle:g})'


def description(chain: Chain) -> str:
    """One line that says what a chain is like."""
    return (
        f'{chain.motion.value}: r/a = {chain.rotor_length / chain.spacing:g}, '
        f'rest angle {chain.rest_angle:g} rad, d = {chain.lean_ratio:.2f}, '
        f'{chain.number_of_rotors} rotors'
    )
