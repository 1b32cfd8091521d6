# SPDX-License-Identifier: Apache-2.0
"""The loops that paint rotors and bonds over a picture, pixel by pixel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    COUNT,
    NUMBER,
    PAINTED,
    PICTURE,
    READ,
    READ_PAINT,
    READ_PAINTED,
    READ_PAINTS,
    READ_PLACES,
    READ_TABLE,
    TABLE,
    compile_loop,
    compiled,
    named_tuple,
)
from soliton_linkage.linkage.chain import Array

Canvas = NDArray[np.float32]
Boxes = NDArray[np.int64]


class Pixels(NamedTuple):
    """What each pixel sees of the plane of the rotors, shape (height, width) each [m]."""

    x: Array
    """Along the chain."""
    z: Array
    """Upwards."""
    spread: Array
    """Standard deviation of the places that it takes light from."""


_PIXELS = named_tuple(Pixels, TABLE, TABLE, TABLE)


def _covered(distance: float, spread: float) -> float:
    """Part of a pixel that a shape covers whose edge is at a distance [m], below 0 inside."""
    share = distance / spread
    if share > 4.0:
        return 0.0
    if share < -4.0:
        return 1.0
    return 0.5 * math.erfc(share * 0.7071067811865476)


def _from_arm(x: float, z: float, across: float, up: float) -> float:
    """Distance of a point from the line from the origin to (across, up), ends included."""
    along = (x * across + z * up) / (across * across + up * up)
    along = min(max(along, 0.0), 1.0)
    return math.hypot(x - along * across, z - along * up)


covered = compile_loop(_covered, inlined=True)
from_arm = compile_loop(_from_arm, inlined=True)


def _shares_of_rotor(
    x: float,
    z: float,
    across: Array,
    up: Array,
    label: float,
    dot: float,
    arm: float,
    spread: float,
) -> tuple[float, float, float, float]:
    """Of arm, label, dot and the rest in a pixel at x, z of a pivot, sums over the samples."""
    of_arm = of_label = of_dot = of_rest = 0.0
    for k in range(len(across)):
        from_mass = math.hypot(x - across[k], z - up[k])
        is_dot = covered(from_mass - dot, spread)
        is_label = covered(from_mass - label, spread)
        is_arm = covered(from_arm(x, z, across[k], up[k]) - arm, spread)
        of_dot += is_dot
        of_label += is_label * (1 - is_dot)
        below = (1 - is_label) * (1 - is_dot)
        of_arm += is_arm * below
        of_rest += (1 - is_arm) * below
    return of_arm, of_label, of_dot, of_rest


shares_of_rotor = compile_loop(_shares_of_rotor, inlined=True)


@compiled(
    *(PAINTED, _PIXELS, COUNT, READ_TABLE, READ, READ),
    *(READ_PLACES, READ_PAINTS, READ, READ, READ),
)
def paint_rotors(
    canvas: Canvas,
    pixels: Pixels,
    parity: int,
    motion: Array,
    pivots: Array,
    lengths: Array,
    boxes: Boxes,
    paint: Canvas,
    shape: Array,
    times: Array,
    instants: Array,
) -> None:
    """Paint every other rotor with its arm and dots.

    `motion` has angles, rates and accelerations at the time 0 of `times`, when rows are exposed
    in the middle, and `instants` of exposures. `shape` has the radii of labels and dots and the
    half width of arms [m].
    """
    label, dot, arm = shape[0], shape[1], shape[2]
    samples = len(instants)
    across, up = np.empty(samples), np.empty(samples)
    for rotor in range(parity, len(pivots), 2):
        left, right, top, bottom = boxes[rotor]
        colour = 4 + rotor % (len(paint) - 4)
        for row in range(top, bottom):
            swept = 0.0
            for k in range(samples):
                t = times[row] + instants[k]
                angle = motion[0, rotor] + t * (motion[1, rotor] + t * motion[2, rotor] / 2)
                across[k] = lengths[rotor] * math.sin(angle)
                up[k] = lengths[rotor] * math.cos(angle)
                swept = max(swept, math.hypot(across[k] - across[0], up[k] - up[0]))
            for column in range(left, right):
                x = pixels.x[row, column] - pivots[rotor]
                z = pixels.z[row, column]
                spread = pixels.spread[row, column]
                if from_arm(x, z, across[0], up[0]) > label + swept + 4 * spread:
                    continue
                pivot_label = covered(math.hypot(x, z) - label, spread)
                pivot_dot = covered(math.hypot(x, z) - dot, spread)
                of_arm, of_label, of_dot, of_rest = shares_of_rotor(
                    x, z, across, up, label, dot, arm, spread
                )
                under = (1 - pivot_label) / samples
                white = under * of_label + pivot_label * (1 - pivot_dot)
                for c in range(3):
                    canvas[row, column, c] = (
                        under
                        * (
                            of_rest * canvas[row, column, c]
                            + of_arm * paint[0, c]
                            + of_dot * paint[colour, c]
                        )
                        + white * paint[1, c]
                        + pivot_label * pivot_dot * paint[2, c]
                    )


@compiled(
    *(PAINTED, _PIXELS, READ_TABLE, READ, READ),
    *(READ_PLACES, READ_PAINT, NUMBER, READ, READ),
)
def paint_bonds(
    canvas: Canvas,
    pixels: Pixels,
    motion: Array,
    pivots: Array,
    lengths: Array,
    boxes: Boxes,
    paint: Canvas,
    width: float,
    times: Array,
    instants: Array,
) -> None:
    """Paint the bonds between the masses of neighbours, of a half width [m]."""
    samples = len(instants)
    masses = np.empty((samples, 4))
    for bond in range(len(pivots) - 1):
        left = min(boxes[bond, 0], boxes[bond + 1, 0])
        right = max(boxes[bond, 1], boxes[bond + 1, 1])
        top = min(boxes[bond, 2], boxes[bond + 1, 2])
        bottom = max(boxes[bond, 3], boxes[bond + 1, 3])
        for row in range(top, bottom):
            swept = 0.0
            for k in range(samples):
                t = times[row] + instants[k]
                for end in range(2):
                    rotor = bond + end
                    angle = motion[0, rotor] + t * (motion[1, rotor] + t * motion[2, rotor] / 2)
                    masses[k, 2 * end] = pivots[rotor] + lengths[rotor] * math.sin(angle)
                    masses[k, 2 * end + 1] = lengths[rotor] * math.cos(angle)
                    across = masses[k, 2 * end] - masses[0, 2 * end]
                    up = masses[k, 2 * end + 1] - masses[0, 2 * end + 1]
                    swept = max(swept, math.hypot(across, up))
            for column in range(left, right):
                x, z = pixels.x[row, column], pixels.z[row, column]
                spread = pixels.spread[row, column]
                from_first = from_arm(
                    x - masses[0, 0],
                    z - masses[0, 1],
                    masses[0, 2] - masses[0, 0],
                    masses[0, 3] - masses[0, 1],
                )
                if from_first > width + swept + 4 * spread:
                    continue
                share = 0.0
                for k in range(samples):
                    distance = from_arm(
                        x - masses[k, 0],
                        z - masses[k, 1],
                        masses[k, 2] - masses[k, 0],
                        masses[k, 3] - masses[k, 1],
                    )
                    share += covered(distance - width, spread)
                share /= samples
                for c in range(3):
                    canvas[row, column, c] += share * (paint[c] - canvas[row, column, c])


@compiled(PAINTED, READ_PAINTS, READ_PAINTED, COUNT, PICTURE)
def expose(
    canvas: Canvas, light: Canvas, noise: Canvas, shift: int, picture: NDArray[np.uint8]
) -> None:
    """Make what a sensor says of a canvas in a light [1], with noise that is shifted sideways."""
    height, width, colours = canvas.shape
    for row in range(height):
        for column in range(width):
            other = column + shift
            if other >= width:
                other -= width
            for c in range(colours):
                value = canvas[row, column, c] * light[row, column] + noise[row, other, c]
                picture[row, column, c] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
