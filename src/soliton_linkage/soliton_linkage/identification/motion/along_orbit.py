# SPDX-License-Identifier: Apache-2.0
"""Inertia and weight of bars along their orbit, and their changes with lengths.

Where lengths and offsets are off by dp, the orbit of the true chain is nearest to that of the one
that is known at

    dphi = -R^T (R R^T)^-1 (df/dp) dp

from its configuration at the same arc, and frames seem to be at arcs that are t . do further on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.identification.geometry.bundle import factor, misclosures
from soliton_linkage.identification.geometry.lengths import Lengths, split
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit

GRID = 0.03
"""Between arcs of the tables [rad]: half of it changes masses by 1e-4."""


class Along(NamedTuple):
    """What moves bars, at the arcs of a grid, of K chains or changes of one."""

    inertia: Array
    """sum m r^2 t^2, shape (G, K)."""
    weight: NDArray[np.complex128]
    """sum m r t (cos phi + i sin phi), shape (G, K)."""


class AlongOrbit:
    """Configurations at even arcs of an orbit, and sums over the rotors there."""

    def __init__(self, orbit: Orbit, lengths: Lengths, arcs: Array) -> None:
        """Lay out a grid that holds some arcs [rad], and a site more on each side."""
        self._lengths = lengths
        self.begin = float(np.nanmin(arcs)) - orbit.site_arc
        """First arc of the grid [rad]."""
        count = math.ceil((float(np.nanmax(arcs)) + orbit.site_arc - self.begin) / GRID)
        grid = self.begin + GRID * np.arange(count + 1)
        self._angles = np.array([orbit.configuration(arc) for arc in grid.tolist()])
        self._tangents = np.array([orbit.tangent(arc) for arc in grid.tolist()])
        r = lengths.rotor_lengths
        self._inertias = (r * self._tangents) ** 2
        self._weights = r * self._tangents * np.exp(1j * self._angles)
        self.rubbing = np.abs(self._tangents).sum(axis=1)
        """sum |t|, shape (G,)."""

    def place(self, arcs: Array) -> tuple[NDArray[np.intp], Array]:
        """Row of the grid before each arc [rad], and the part of the way to the next [1]."""
        at = (arcs - self.begin) / GRID
        row = np.clip(at, 0, len(self.rubbing) - 2).astype(np.intp)
        return row, np.clip(at - row, 0.0, 1.0)

    def tangents(self, arcs: Array) -> Array:
        """Unit tangents at arcs [rad], (T, N)."""
        row, part = self.place(arcs)
        before, after = self._tangents[row], self._tangents[row + 1]
        return np.asarray(before + part[:, None] * (after - before))

    def of_masses(self, masses: Array) -> Along:
        """Sums for masses [1], of which each column is of a chain, shape (N, K)."""
        return Along(self._inertias @ masses, self._weights @ masses)

    def changes(self, masses: Array, changes: Array) -> Along:
        """Changes of these sums for masses [1], (N,), with changes of the unknowns, (P, K)."""
        t, r = self._tangents, self._lengths.rotor_lengths
        about = misclosures(self._lengths, self._angles.T)
        factors = factor(about.first, about.second, np.ones_like(t.T))
        turns = r * np.exp(1j * self._angles)
        inertia = np.empty((len(t), changes.shape[1]))
        weight = inertia.astype(np.complex128)
        for column, change in enumerate(changes.T):
            rotor, _, spacing, rest = split(change)
            of_bonds = (rotor[:-1], 0 * rest, spacing, rest, rotor[1:], 0 * rest)
            closing = np.einsum('ngu,un->ng', about.slopes, np.array(of_bonds))
            moved = -about.pulled(factors.solved(factors.whitened(closing))).T
            along = np.gradient(moved, GRID, axis=0) + rotor * t
            inertia[:, column] = 2 * (r**2 * t * along) @ masses
            weight[:, column] = (turns * (along + 1j * t * moved)) @ masses
        return Along(inertia, weight)


def arcs_of(orbit: Orbit, angles: Array, noise: float) -> tuple[Array, Array]:
    """Arc of each frame and its standard deviation [rad], shape (T,) each."""
    arc = fit_anywhere(orbit, angles[0]).arc
    found = []
    for frame in angles:
        nearest = fit_near(orbit, frame, arc)
        arc = nearest.arc
        found.append((arc, noise / math.sqrt(max(nearest.information, 1e-6))))
    arcs, spreads = np.array(found).T
    return arcs, spreads
