# SPDX-License-Identifier: Apache-2.0
"""Rotors that a frame does not show, by the springs between them and those that it shows.

Waves and springs have the rotors of a frame beside the orbit, by xi that is orthogonal to its
tangent t. Of unseen rotors u the nearest point of the orbit to all others is off by

    sum_u t xi / sum_s t^2.

Springs have rotors go round the orbit at a rate w, and slow waves leave them in that balance,
K_uu xi_u = -K_us xi_s - I w^2 Phi''_u of K = R^T k R. With V = K_uu^-1 t_u the sum above is
D = -V . (K_us xi_s + I w^2 Phi''_u), which the frame shows. What waves of a frequency omega have
beside that is omega^2 I / K of xi, where most have that of the gap. Noise sigma of the rotors that
are seen makes D unsure by |q| sigma, and without it waves f are so by f |t_u|: D is taken where
that is more.
"""

from __future__ import annotations

import numpy as np

from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit

_NEGLIGIBLE = 0.01
"""Of the variance by noise, below which unseen rotors make no difference [1]."""
_UNTOLD = 1e-6
"""Share of the arc that the others have, below which they tell nothing of it [1]."""


class UnseenRotors:
    """Tells what unseen rotors do to the nearest point of an orbit."""

    def __init__(self, orbit: Orbit) -> None:
        """Work out how well slow waves leave springs in balance."""
        self._orbit = orbit
        lower, upper = (edge**2 for edge in band_edges(orbit.chain))
        self.left = (2 * lower / (lower + upper)) ** 2
        """Share of the variance by unseen rotors that springs leave [1]."""

    def shift(
        self, arc: float, rate: float, residuals: Array, field: float, noise: float
    ) -> float:
        """Shift of the nearest point to residuals from it [rad], shape (N,), NaN of unseen rotors.

        It is 0 where noise hides it. The rate is that of the arc [rad/s], the variances are those
        of a rotor by what is beside the orbit and by noise [rad^2].
        """
        unseen = np.isnan(residuals)
        tangent = self._orbit.tangent(arc)
        untold = float(tangent[unseen] @ tangent[unseen])
        told = 1 - untold
        if untold * field <= _NEGLIGIBLE * noise or told <= _UNTOLD:
            return 0.0
        held, pull = self._balanced(arc, unseen, tangent)
        shown = told * pull[~unseen] + untold * tangent[~unseen]
        if untold * field * told**2 < float(shown @ shown) * noise:
            return 0.0
        turning = self._orbit.chain.moments_of_inertia * self._orbit.bend(arc) * rate**2
        return -float(held @ turning + pull[~unseen] @ residuals[~unseen])

    def _balanced(self, arc: float, unseen: Flags, tangent: Array) -> tuple[Array, Array]:
        """V, which is 0 of seen rotors, and K V, which is t of unseen ones, shape (N,) each."""
        chain = self._orbit.chain
        first, second = rigidity_bands(chain, self._orbit.configuration(arc))
        rotors = np.flatnonzero(unseen)
        pulled = np.zeros((len(rotors), len(unseen)))
        for row, rotor in enumerate(rotors):
            pulled[row, rotor] = 1.0
        extensions = first * pulled[:, :-1] + second * pulled[:, 1:]
        tensions = chain.stiffnesses * extensions
        stiffness = chain.gathered(first * tensions, second * tensions)
        held = np.zeros_like(tangent)
        held[rotors] = np.linalg.solve(stiffness[:, rotors], tangent[rotors])
        return held, held[rotors] @ stiffness
