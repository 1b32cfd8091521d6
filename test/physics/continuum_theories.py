# SPDX-License-Identifier: Apache-2.0
"""The continuum theory of a chain, whichever it is, and the densities of its energies."""

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory

WIDEST_FLIPPER = (0.5, 0.1)
Theory = FlipperTheory | SpinnerTheory


def theory_of(chain: Chain, exact_sound: bool = True) -> Theory:
    if chain.motion is Motion.SPINNER:
        return SpinnerTheory(chain, exact_sound)
    return FlipperTheory(chain, exact_sound)


def elastic_density(theory: Theory, field: Array, slopes: Array) -> Array:
    """Return the elastic energy per length in the Lagrangian of the theory [J/m]."""
    chain, misfit = theory.chain, slopes - theory.static_slope(field)
    if isinstance(theory, SpinnerTheory):
        return np.asarray(theory.effective_stiffness * misfit**2 / (2 * chain.spacing))
    stretch = chain.spacing**2 * misfit / chain.rest_length
    return np.asarray(chain.stiffness * stretch**2 / (2 * chain.spacing))


def kinetic_density(theory: Theory, rates: Array) -> Array:
    """Return the kinetic energy per length in the Lagrangian of the theory [J/m]."""
    chain = theory.chain
    inertia = chain.moment_of_inertia if isinstance(theory, SpinnerTheory) else chain.mass
    return np.asarray(inertia * np.square(rates) / (2 * chain.spacing))
