# SPDX-License-Identifier: Apache-2.0
"""Motions of chains in which each thing that can act does so, for integrators to be tried on."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from chains import FLIPPER, SPINNER
from deviating_chains import random_deviations

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.linkage.gravity import Gravity


def unit_chain(rotors: int, example: tuple[float, float] = FLIPPER, **others: object) -> Chain:
    ratio, rest_angle = example
    chain = Chain(rotors, 1.0, ratio, rest_angle, 1.0, 1.0)
    return dataclasses.replace(chain, **others)


def motions() -> Mapping[str, EquationOfMotion]:
    torques = np.random.default_rng(6).normal(0, 0.02, 11)
    rough = unit_chain(11, deviations=random_deviations(11, 10, 5, 0.05))
    return {
        'flipper': EquationOfMotion(unit_chain(11)),
        'whole vectors': EquationOfMotion(unit_chain(16)),
        'two rotors': EquationOfMotion(unit_chain(2)),
        'spinner': EquationOfMotion(unit_chain(13, SPINNER)),
        'ring': EquationOfMotion(unit_chain(16, periodic=True)),
        'ring, padded': EquationOfMotion(unit_chain(10, periodic=True)),
        'deviating': EquationOfMotion(rough),
        'deviating ring': EquationOfMotion(
            unit_chain(10, periodic=True, deviations=random_deviations(10, 10, 5, 0.05))
        ),
        'gravity and torques': EquationOfMotion(unit_chain(11), torques, Gravity(0.1, 0.4)),
        'damped': EquationOfMotion(unit_chain(11, damping=0.03)),
        'fixed': EquationOfMotion(unit_chain(11), torques, fixed=(0, 4)),
        'on-site potential': EquationOfMotion(
            unit_chain(11, on_site_torque=0.05, on_site_order=3, on_site_phase=0.3)
        ),
        'non-reciprocal flipper': EquationOfMotion(unit_chain(11, non_reciprocity=0.02)),
        'non-reciprocal ring': EquationOfMotion(
            unit_chain(10, SPINNER, periodic=True, non_reciprocity=-0.02, damping=0.03)
        ),
        'all at once': EquationOfMotion(
            dataclasses.replace(rough, damping=0.02), torques, Gravity(0.1, -0.4), (3,)
        ),
    }


MOTIONS = motions()


def lively_state(motion: EquationOfMotion, seed: int = 1, speed: float = 0.2) -> Array:
    rng = np.random.default_rng(seed)
    angles = motion.chain.uniform_state(1) + rng.normal(0, 0.1, motion.rotors)
    rates = rng.normal(0, speed, motion.rotors) * np.isfinite(motion.inertias)
    return motion.state(angles, rates)


def coordinates(chain: Chain, angles: Array) -> Array:
    return np.array(angles) if chain.motion is Motion.SPINNER else staggered(angles)


def motor_torques(chain: Chain, angles: Array) -> Array:
    """Non-reciprocal torques, bond by bond in the coordinates of the rotors."""
    q = coordinates(chain, angles)
    return _of_bonds(chain, [math.remainder(d, 2 * math.pi) for d in q - np.roll(q, -1)])


def _of_bonds(chain: Chain, differences: Sequence[float]) -> Array:
    found = np.zeros(chain.number_of_rotors)
    for bond, kappa in enumerate(chain.non_reciprocities):
        found[bond] += kappa * differences[bond]
        found[(bond + 1) % len(found)] += kappa * differences[bond]
    return found * chain.signs
