# SPDX-License-Identifier: Apache-2.0
"""Captions and labels of chains in pictures and tables."""

from __future__ import annotations

from soliton_linkage.linkage.chain import Chain

LINKAGE = (
    'Black crosses are the pivots, black bars the rotors and blue dots the masses at their ends. '
    'Where rotors overlap their neighbours, every other rotor is grey. r is the rotor length, a '
    'the rotor spacing, θ̄ the rest angle, and d = 2 r sin θ̄ / a.'
)
MODE = 'green arrows are the velocities of the masses in this mode, all drawn to the same scale'
"""Clause of a caption that explains the zero-mode arrows."""
PROJECTIONS = (
    'Arrows below the pivots are the horizontal displacements u = r sin φ of the masses, in '
    'several rows if they would overlap. Arrows to the right are purple, arrows to the left are '
    'orange, and short arrows are paler.'
)


def parameters(chain: Chain) -> str:
    """Return a text with the shape parameters r/a and rest angle [rad]."""
    return f'r/a = {chain.rotor_length / chain.spacing:g}, θ̄ = {chain.rest_angle:g}'


def shape(chain: Chain) -> str:
    """Return a text with r/a, the rest angle [rad] and the lean ratio d."""
    return f'{parameters(chain)}, d = {chain.lean_ratio:.2f}'


def class_and_shape(chain: Chain) -> str:
    """Return the motion class, followed by r/a and the rest angle [rad] in parentheses."""
    ratio = chain.rotor_length / chain.spacing
    return f'{chain.motion.value} ({ratio:g}, {chain.rest_angle:g})'


def description(chain: Chain) -> str:
    """Return a one-line description: class, r/a, rest angle, lean ratio and rotor count."""
    return (
        f'{chain.motion.value}: r/a = {chain.rotor_length / chain.spacing:g}, '
        f'rest angle {chain.rest_angle:g} rad, d = {chain.lean_ratio:.2f}, '
        f'{chain.number_of_rotors} rotors'
    )
