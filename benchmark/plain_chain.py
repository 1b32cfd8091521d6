# SPDX-License-Identifier: Apache-2.0
"""Equation of motion of a chain of springs in plain numpy."""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain


def derivative(chain: Chain, state: Array) -> Array:
    """Return the rates and accelerations of a chain, given its angles and rates, shape (2 N,)."""
    number, r = chain.number_of_rotors, chain.rotor_length
    angles, rates = state[:number], state[number:]
    x = chain.spacing * np.arange(number) + r * np.sin(angles)
    z = r * np.cos(angles)
    dx, dz = np.diff(x), np.diff(z)
    length = np.sqrt(dx**2 + dz**2)
    tension = chain.stiffness * (length - chain.rest_length) / length
    force_x, force_z = np.zeros(number), np.zeros(number)
    force_x[:-1] += tension * dx
    force_x[1:] -= tension * dx
    force_z[:-1] += tension * dz
    force_z[1:] -= tension * dz
    torques = r * (np.cos(angles) * force_x - np.sin(angles) * force_z)
    return np.concatenate([rates, torques / chain.moment_of_inertia])
