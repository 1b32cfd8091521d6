# SPDX-License-Identifier: Apache-2.0
"""Positions, sizes and colours of the markers of a chain.

Pivots have black dots on white labels, and masses have dots in red, green and blue, in turn. ArUco
markers on the frame have black dots beyond their corners. The markers identify these dots, and the
dots define the plane of the chain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import check_quantities, document_fields, quantity
from soliton_linkage.vision.opencv import opencv

DICTIONARY = 'DICT_4X4_50'
"""ArUco dictionary with the fewest cells; its markers are detected from the largest distance."""
MODULES = 6
"""Number of cells along the side of a frame marker, including the black border."""
DOT_SHARE = 0.48
"""Diameter of a dot divided by the diameter of its label [1]; a wide white margin is necessary
because edges in pictures are blurred."""
COLOURS = ((0, 0, 0), (200, 30, 40), (0, 120, 60), (30, 60, 190))
"""Red, green and blue [0 to 255] of the dots: the first row is for pivots, the others for
masses."""
_LABEL_OF_SPACING, _LABEL_OF_ROTOR = 0.45, 0.9
"""The diameter of a label is the smaller one of the first number times the spacing and the second
number times the rotor length [1]."""
_MARKER_OF_SPACING = 0.9
"""Side of a frame marker, relative to the spacing [1]."""
_MIN_DISTANCE = 1.05
"""Smallest distance between centres of frame markers, relative to the side of their paper [1]."""
_LABEL_GAP = 0.25
"""Gap between the paper of a frame marker and labels of masses, relative to the spacing [1]."""


@document_fields
@dataclass(frozen=True)
class MarkerSettings:
    """Sizes and positions of markers; raises ValueError for values out of range."""

    label_diameter: float = quantity(
        0.0, 'diameter of the white labels; 0 derives it from the chain', 'm', 0.0, 1.0
    )
    frame_marker_size: float = quantity(
        0.0, 'side of the black frame markers; 0 derives it from the chain', 'm', 0.0, 10.0
    )
    frame_columns: int = quantity(3, 'pairs of frame markers along the chain', '', 2, 25)
    frame_x: tuple[float, ...] = quantity(
        (), 'x of the centre of each frame marker [m], in the order of the marker numbers'
    )
    frame_z: tuple[float, ...] = quantity((), 'z of the centre of each frame marker [m]')
    placing_tolerance: float = quantity(
        5e-4, 'standard deviation of the positions of the frame markers', 'm', 0.0, 0.1
    )
    even_height: float = quantity(
        0.0, 'height of the dots of even rotors above the plane of the frame markers', 'm', -10, 10
    )
    odd_height: float = quantity(
        0.0, 'height of the dots of odd rotors above the plane of the frame markers', 'm', -10, 10
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        if len(self.frame_x) != len(self.frame_z) or len(self.frame_x) not in (0, *range(2, 51)):
            raise ValueError(
                f'markers.frame_x has {len(self.frame_x)} values and markers.frame_z '
                f'{len(self.frame_z)}; give both the same number of values, 2 to 50, or none'
            )


@dataclass(frozen=True)
class MarkerLayout:
    """Markers of a chain; positions (x, z) have x along the chain from pivot 0 and z upwards."""

    chain: Chain
    settings: MarkerSettings = MarkerSettings()

    @cached_property
    def label_radius(self) -> float:
        """Radius of the white labels [m]."""
        chain = self.chain
        fitting = min(_LABEL_OF_SPACING * chain.spacing, _LABEL_OF_ROTOR * chain.rotor_length)
        return (self.settings.label_diameter or fitting) / 2

    @cached_property
    def dot_radius(self) -> float:
        """Radius of the dots [m]."""
        return DOT_SHARE * self.label_radius

    @cached_property
    def colours(self) -> NDArray[np.intp]:
        """Colour of the dot on each mass, as an index in `COLOURS`, (N,)."""
        return 1 + np.arange(self.chain.number_of_rotors) % (len(COLOURS) - 1)

    @cached_property
    def heights(self) -> Array:
        """Height of both dots of each rotor (mass, pivot) above the plane of the frame markers.

        Heights are positive towards the camera [m], (N,).
        """
        odd = np.arange(self.chain.number_of_rotors) % 2
        return np.where(odd, self.settings.odd_height, self.settings.even_height)

    @cached_property
    def frame_marker_size(self) -> float:
        """Side of the frame markers [m]."""
        return self.settings.frame_marker_size or _MARKER_OF_SPACING * self.chain.spacing

    @cached_property
    def frame_centres(self) -> Array:
        """Centres of the frame markers [m], (M, 2)."""
        if self.settings.frame_x:
            return np.column_stack([self.settings.frame_x, self.settings.frame_z])
        chain, size = self.chain, self.frame_marker_size
        length = float(chain.pivots[-1])
        away = float(chain.rotor_lengths.max()) + self.label_radius
        away += self.paper_size / 2 + _LABEL_GAP * chain.spacing
        distance = _MIN_DISTANCE * self.paper_size
        half = max((length + size) / 2, distance / 2)
        columns = min(self.settings.frame_columns, 1 + int(2 * half / distance))
        # Positions are whole millimetres, so that a ruler suffices to place the markers.
        first = math.floor(round(1e3 * (length / 2 - half), 6))
        step = math.ceil(round(2e3 * half / max(columns - 1, 1), 6))
        row = math.ceil(round(1e3 * away, 6))
        centres = [(first + step * column, z) for column in range(columns) for z in (row, -row)]
        return np.array(centres) / 1e3

    @cached_property
    def frame_corners(self) -> Array:
        """Corners of the frame markers, clockwise from the upper left [m], (M, 4, 2)."""
        return self._squares(self.frame_marker_size / 2)

    @cached_property
    def frame_dots(self) -> Array:
        """Centres of the dots outside the `frame_corners`, in the same order [m], (M, 4, 2)."""
        return self._squares(self.frame_marker_size / 2 + self.label_radius)

    @cached_property
    def paper_size(self) -> float:
        """Side of the white square on which a frame marker and its dots are printed [m]."""
        return self.frame_marker_size + 4 * self.label_radius

    @cached_property
    def as_printed(self) -> MarkerSettings:
        """Settings with which another chain can use the same printed markers."""
        return replace(
            self.settings,
            label_diameter=2 * self.label_radius,
            frame_marker_size=self.frame_marker_size,
            frame_x=tuple(self.frame_centres[:, 0].tolist()),
            frame_z=tuple(self.frame_centres[:, 1].tolist()),
        )

    def _squares(self, half: float) -> Array:
        corners = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        return np.asarray(self.frame_centres[:, None] + corners)

    @cached_property
    def bounds(self) -> Array:
        """Box that contains all labels: lowest x and z, highest x and z [m], (2, 2)."""
        chain = self.chain
        reach = float(chain.rotor_lengths.max()) + self.label_radius
        return np.array([[-reach, -reach], [float(chain.pivots[-1]) + reach, reach]])


def marker_cells(number: int) -> NDArray[np.uint8]:
    """Return the cells of a frame marker, 0 for black, (MODULES, MODULES)."""
    aruco = opencv().aruco
    dictionary = aruco.getPredefinedDictionary(getattr(aruco, DICTIONARY))
    draw = getattr(aruco, 'generateImageMarker', None) or aruco.drawMarker
    return np.asarray(draw(dictionary, number, MODULES), dtype=np.uint8)
