# SPDX-License-Identifier: Apache-2.0
"""Plane of a chain in front of a camera.

Heights h above the plane are positive towards the camera. The ray from the camera to the point (x,
z) at the height h is

    x g1 + z g2 + g3 + h n,    n = c / sqrt(|c|),    c = cross(g1, g2),

with the axes g1 and g2 of the plane and its origin g3. The product of the lengths of g1 and g2 is
1. If the lens is calibrated, g1 and g2 are perpendicular unit vectors, and n = c.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.opencv import opencv

MIN_POINTS = 6
"""Smallest number of points for the fit of a plane and the computation of its residual."""


@dataclass(frozen=True)
class ChainPlane:
    """Map between points (x, z) of the plane of a chain [m] and pixels."""

    camera: Camera
    columns: Array
    """Matrix with the columns g1, g2 and g3, (3, 3)."""

    @cached_property
    def _normal(self) -> Array:
        """Normal n of the plane, which points towards the camera (see the module)."""
        normal = np.cross(self.columns[:, 0], self.columns[:, 1])
        return np.asarray(normal / np.linalg.norm(normal) * np.sqrt(np.linalg.norm(normal)))

    def pixels(self, points: Array, heights: ArrayLike = 0.0) -> Array:
        """Return the pixels, (..., 2), at which points (x, z) [m] at given heights [m] appear."""
        rays = points @ self.columns[:, :2].T + self._origins(points, heights)
        return self.camera.pixels(rays[..., :2] / rays[..., 2:])

    def points(self, pixels: Array, heights: ArrayLike = 0.0) -> Array:
        """Return the points (x, z) [m], (..., 2), at given heights [m] that appear at `pixels`."""
        rays = self.camera.rays(pixels)
        origins = self._origins(rays, heights)
        g1, g2 = self.columns[:, 0], self.columns[:, 1]
        (a, b), (c, d) = (
            (g1[i] - rays[..., i] * g1[2], g2[i] - rays[..., i] * g2[2]) for i in (0, 1)
        )
        e, f = (rays[..., i] * origins[..., 2] - origins[..., i] for i in (0, 1))
        solved = np.stack([e * d - b * f, a * f - e * c], axis=-1)
        return np.asarray(solved / (a * d - b * c)[..., None])

    def pixels_per_metre(self, points: Array) -> Array:
        """Return the scale of the picture at each point [pixels/m], a mean over all directions."""
        unit = float(np.sqrt(np.linalg.norm(np.cross(*self.columns[:, :2].T))))
        step = 1e-4 * abs(self.columns[2, 2]) / unit
        ends = np.stack([points + side * axis for axis in step * np.eye(2) for side in (1, -1)])
        right, left, top, bottom = self.pixels(ends)
        across, up = right - left, top - bottom
        area = np.abs(across[..., 0] * up[..., 1] - across[..., 1] * up[..., 0])
        return np.asarray(np.sqrt(area) / (2 * step))

    def metres_per_pixel(self, pixels: Array, heights: ArrayLike = 0.0) -> Array:
        """Return the derivative of the result of `points` by `pixels` [m/pixel], (..., 2, 2)."""
        ends = np.stack([pixels + side * axis for axis in 0.5 * np.eye(2) for side in (1, -1)])
        points = self.points(ends, heights)
        return np.stack([points[0] - points[1], points[2] - points[3]], axis=-1)

    def circle_centres(self, image_centres: Array, radius: float) -> Array:
        """Return the pixels at which the centres of circles of a `radius` [m] appear, (K, 2).

        In a picture, a circle appears as an ellipse. The centre of the ellipse, in `image_centres`
        [pixels], (K, 2), differs from the pixel at which the centre of the circle appears.
        """
        turns = np.arange(16) * (np.pi / 8)
        circle = radius * np.column_stack([np.cos(turns), np.sin(turns)])
        outlines = self.pixels(self.points(image_centres)[:, None] + circle)
        outlines = outlines - image_centres[:, None]
        following = np.roll(outlines, -1, axis=1)
        crossed = outlines[..., 0] * following[..., 1] - following[..., 0] * outlines[..., 1]
        moments = np.sum((outlines + following) * crossed[..., None], axis=1)
        return np.asarray(image_centres - moments / (3 * crossed.sum(axis=1, keepdims=True)))

    def _origins(self, points: Array, heights: ArrayLike) -> Array:
        up = np.broadcast_to(np.asarray(heights, dtype=np.float64), points.shape[:-1])
        return np.asarray(self.columns[:, 2] + up[..., None] * self._normal)


def fit_plane(camera: Camera, points: Array, pixels: Array) -> tuple[ChainPlane, float]:
    """Return a plane that maps K points [m] to `pixels`, (K, 2) each, and the residual [pixels].

    K is at least `MIN_POINTS`. The residual is the root mean square error of a coordinate. Raises
    ValueError if all points lie on one line.
    """
    # OpenCV needs coordinates of the order of 1.
    scale = float(np.ptp(points, axis=0).max()) or 1.0
    found, _ = opencv().findHomography(points / scale, camera.rays(pixels), 0)
    if found is None or not np.isfinite(found).all():
        raise ValueError('all frame markers lie on one line; spread them around the chain')
    columns = np.asarray(found, dtype=np.float64) / [scale, scale, 1.0]
    columns /= np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    if columns[2] @ [*np.mean(points, axis=0), 1.0] < 0:
        columns = -columns
    plane = ChainPlane(camera, columns)
    residuals = plane.pixels(points) - pixels
    return plane, float(np.sqrt(np.sum(residuals**2) / max(residuals.size - 8, 1)))
