# SPDX-License-Identifier: Apache-2.0
"""Errors of angles due to errors in the stated positions of the frame markers.

The plane of the chain is fitted to the dots of the frame markers. Small displacements of the
markers displace the fitted plane by a field u, which is linear in these displacements. For a
homography the field is, to first order,

    u_x = p0 + p1 x + p2 z + p6 x^2 + p7 x z,
    u_z = p3 + p4 x + p5 z + p6 x z + p7 z^2.

A rotor's angle changes by the difference of the field between both ends of the rotor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array


class PlacingErrors:
    """Standard deviations of angles per standard deviation of the marker positions."""

    def __init__(self, dots: Array, markers: NDArray[np.intp]) -> None:
        """Prepare for visible dots [m], shape (K, 2), and the marker of each, shape (K,)."""
        self._centre, self._scale = dots.mean(axis=0), float(np.ptp(dots, axis=0).max())
        moved = np.kron(markers[:, None] == np.unique(markers), np.eye(2))
        fields = self._fields(dots).reshape(-1, 8)
        self._parameters = np.linalg.lstsq(fields, moved, rcond=None)[0]

    def deviations(self, pivots: Array, arms: Array) -> Array:
        """Return the deviation of the angle of each rotor [rad/m], given pivots and arms [m]."""
        change = self._fields(pivots + arms) - self._fields(pivots)
        across = np.stack([arms[:, 1], -arms[:, 0]], axis=1) / np.sum(arms**2, axis=1)[:, None]
        turns = np.einsum('ni,nij->nj', across, change) @ self._parameters
        return np.asarray(np.sqrt(np.sum(turns**2, axis=1)))

    def _fields(self, points: Array) -> Array:
        """Return the derivative of the field by each parameter at points [m], shape (K, 2, 8)."""
        x, z = ((points - self._centre) / self._scale).T
        one, none = np.ones_like(x), np.zeros_like(x)
        along = [one, x, z, none, none, none, x * x, x * z]
        up = [none, none, none, one, x, z, x * z, z * z]
        return np.stack([np.stack(along, axis=1), np.stack(up, axis=1)], axis=1)
