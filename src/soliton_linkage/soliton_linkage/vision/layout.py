# SPDX-License-Identifier: Apache-2.0
"""Markers of a chain: places, sizes and colours.

Each pivot has a black dot on a white label and each mass a coloured one, red, green and blue in
turn. On the frame, above and below the chain, are ArUco markers with a black dot beyond each
corner: the markers identify these dots, and the dots define the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import check_quantities, document_fields, quantity
from soliton_linkage.vision.opencv import opencv

DICTIONARY = 'DICT_4X4_50'
"""Dictionary of the frame markers: the one with the fewest cells is seen from farthest."""
MODULES = 6
"""Cells along the side of a frame marker with its black border [1]."""
DOT_SHARE = 0.48
"""Diameter of a dot over that of its label [1]: blur needs as much white beside it."""
COLOURS = ((0, 0, 0), (200, 30, 40), (0, 120, 60), (30, 60, 190))
"""Red, green and blue of the dots of pivots, and of masses in turn [0 to 255]. Their luminances
differ from white, and their hues from each other."""
_LABEL_OF_SPACING, _LABEL_OF_ROTOR = 0.45, 0.9
"""Largest diameter of a label, over the spacing and over a rotor's length [1]."""
_MARKER_OF_SPACING = 0.9
"""Side of a frame marker over the spacing [1]."""
_APART = 1.05
"""Least distance of frame markers, over the side of their paper [1]."""
_BETWEEN = 0.25
"""Distance of the paper of frame markers from the nearest labels, over the spacing [1]."""


@document_fields
@dataclass(frozen=True)
class MarkerSettings:
    """Sizes and places of markers; raises ValueError for values out of their range."""

    label_diameter: float = quantity(
        0.0, 'diameter of the white labels, 0 for what fits the chain', 'm', 0.0, 1.0
    )
    frame_marker_size: float = quantity(
        0.0, 'side of the black frame markers, 0 for what fits the chain', 'm', 0.0, 10.0
    )
    frame_columns: int = quantity(3, 'pairs of frame markers along the chain', '', 2, 25)
    frame_x: tuple[float, ...] = quantity(
        (), 'x of the centre of each frame marker [m], in the order of their numbers'
    )
    frame_z: tuple[float, ...] = quantity((), 'z of the centre of each frame marker [m]')
    even_height: float = quantity(
        0.0, 'how far in front of the frame markers the dots of rotors 0, 2, ... are', 'm', -10, 10
    )
    odd_height: float = quantity(0.0, 'and those of rotors 1, 3, ...', 'm', -10, 10)

    def __post_init__(self) -> None:
        """Reject values out of their range."""
        check_quantities(self)
        if len(self.frame_x) != len(self.frame_z) or len(self.frame_x) not in (0, *range(2, 51)):
            raise ValueError(
                f'{len(self.frame_x)} values of markers.frame_x and {len(self.frame_z)} of '
                'markers.frame_z must be as many as each other, 2 to 50, or none'
            )


@dataclass(frozen=True)
class MarkerLayout:
    """The markers of a chain, all in its plane: x along it from rotor 0, z up [m]."""

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
        """Which of `COLOURS` the dot of each mass has, shape (N,)."""
        return 1 + np.arange(self.chain.number_of_rotors) % (len(COLOURS) - 1)

    @cached_property
    def heights(self) -> Array:
        """Of the dots of each rotor above the frame markers, towards the camera [m], (N,)."""
        odd = np.arange(self.chain.number_of_rotors) % 2
        return np.where(odd, self.settings.odd_height, self.settings.even_height)

    @cached_property
    def frame_marker_size(self) -> float:
        """Side of the frame markers [m]."""
        return self.settings.frame_marker_size or _MARKER_OF_SPACING * self.chain.spacing

    @cached_property
    def frame_centres(self) -> Array:
        """Centre of each frame marker by its number [m], shape (M, 2)."""
        if self.settings.frame_x:
            return np.column_stack([self.settings.frame_x, self.settings.frame_z])
        chain, size = self.chain, self.frame_marker_size
        length = float(chain.pivots[-1])
        away = float(chain.rotor_lengths.max()) + self.label_radius
        away += self.paper_size / 2 + _BETWEEN * chain.spacing
        apart = _APART * self.paper_size
        half = max((length + size) / 2, apart / 2)
        columns = min(self.settings.frame_columns, 1 + int(2 * half / apart))
        places = length / 2 + np.linspace(-half, half, columns)
        return np.array([(x, z) for x in places for z in (away, -away)])

    @cached_property
    def frame_corners(self) -> Array:
        """Corners of each frame marker [m], from the upper left clockwise, shape (M, 4, 2)."""
        return self._about_centres(self.frame_marker_size / 2)

    @cached_property
    def frame_dots(self) -> Array:
        """Dots of each frame marker [m], in the same order, shape (M, 4, 2)."""
        return self._about_centres(self.frame_marker_size / 2 + self.label_radius)

    @cached_property
    def paper_size(self) -> float:
        """Side of the white square with a frame marker and its dots [m]."""
        return self.frame_marker_size + 4 * self.label_radius

    @cached_property
    def as_printed(self) -> MarkerSettings:
        """Settings with every size and place told: the paper stays as it is for another chain."""
        return replace(
            self.settings,
            label_diameter=2 * self.label_radius,
            frame_marker_size=self.frame_marker_size,
            frame_x=tuple(self.frame_centres[:, 0].tolist()),
            frame_z=tuple(self.frame_centres[:, 1].tolist()),
        )

    def _about_centres(self, half: float) -> Array:
        corners = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        return np.asarray(self.frame_centres[:, None] + corners)

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest x and z that a label reaches [m], shape (2, 2)."""
        chain = self.chain
        reach = float(chain.rotor_lengths.max()) + self.label_radius
        return np.array([[-reach, -reach], [float(chain.pivots[-1]) + reach, reach]])


def marker_cells(number: int) -> NDArray[np.uint8]:
    """Cells of a frame marker, 0 where they are black, shape (MODULES, MODULES)."""
    aruco = opencv().aruco
    dictionary = aruco.getPredefinedDictionary(getattr(aruco, DICTIONARY))
    draw = getattr(aruco, 'generateImageMarker', None) or aruco.drawMarker
    return np.asarray(draw(dictionary, number, MODULES), dtype=np.uint8)
