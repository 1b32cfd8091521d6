# SPDX-License-Identifier: Apache-2.0
"""Compiled loops that render rotors and bonds into a picture, pixel by pixel.

Each pivot and each mass carries a label, a white paper disc. In the middle of the label is a dot,
which is black on pivots and coloured on masses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    compile_loop,
    compiled,
    const_f4_1d,
    const_f4_2d,
    const_f4_3d,
    const_f8_1d,
    const_f8_2d,
    const_i8_2d,
    f4_3d,
    f8,
    f8_2d,
    i8,
    named_tuple,
    u1_3d,
)
from soliton_linkage.linkage.chain import Array

Canvas = NDArray[np.float32]
Boxes = NDArray[np.int64]


class Pixels(NamedTuple):
    """Points (x, z) of the rotor plane that the pixels show [m].

    `spread` is the standard deviation of the blur [m]. All arrays have the shape (height, width).
    """

    x: Array
    z: Array
    spread: Array


_PIXELS = named_tuple(Pixels, f8_2d, f8_2d, f8_2d)


def _covered(distance: float, spread: float) -> float:
    share = distance / spread
    if share > 4.0:
        return 0.0
    if share < -4.0:
        return 1.0
    return 0.5 * math.erfc(share * 0.7071067811865476)


def _from_arm(x: float, z: float, across: float, up: float) -> float:
    along = (x * across + z * up) / (across * across + up * up)
    along = min(max(along, 0.0), 1.0)
    return math.hypot(x - along * across, z - along * up)


def _mass_of(rotors: Array, rotor: int, time: float) -> tuple[float, float]:
    angle = rotors[0, rotor] + time * (rotors[1, rotor] + time * rotors[2, rotor] / 2)
    return rotors[4, rotor] * math.sin(angle), rotors[4, rotor] * math.cos(angle)


covered = compile_loop(_covered, inlined=True)
from_arm = compile_loop(_from_arm, inlined=True)
mass_of = compile_loop(_mass_of, inlined=True)


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


@compiled(f4_3d, _PIXELS, i8, const_f8_2d, const_i8_2d, const_f4_2d, const_f8_1d, const_f8_2d)
def paint_rotors(
    canvas: Canvas,
    pixels: Pixels,
    parity: int,
    rotors: Array,
    boxes: Boxes,
    paint: Canvas,
    shape: Array,
    moments: Array,
) -> None:
    """Paint the arms, labels and dots of every second rotor, starting with rotor `parity`.

    The first three rows of `rotors` are the angles [rad], rates [rad/s] and accelerations
    [rad/s^2] at the time stamp of the picture. The other rows are the x coordinates of the pivots
    [m] and the rotor lengths [m]. `boxes` contains the left, right, top and bottom limits of each
    rotor [pixels]. The rows of `paint` are the BGR colours [0 to 255] of arms, labels, pivot dots
    and bonds, then of the dots on masses. `shape` contains the radius of labels, the radius of
    dots and the half width of arms [m]. `moments` contains the times at which each picture row is
    rendered, minus the time stamp [s], shape (height, instants).
    """
    label, dot, arm = shape[0], shape[1], shape[2]
    samples = moments.shape[1]
    across, up = np.empty(samples), np.empty(samples)
    for rotor in range(parity, len(boxes), 2):
        left, right, top, bottom = boxes[rotor]
        colour = 4 + rotor % (len(paint) - 4)
        for row in range(top, bottom):
            swept = 0.0
            for k in range(samples):
                across[k], up[k] = mass_of(rotors, rotor, moments[row, k])
                swept = max(swept, math.hypot(across[k] - across[0], up[k] - up[0]))
            for column in range(left, right):
                x = pixels.x[row, column] - rotors[3, rotor]
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
                    below = of_rest * canvas[row, column, c] + of_arm * paint[0, c]
                    below += of_dot * paint[colour, c]
                    canvas[row, column, c] = (
                        under * below + white * paint[1, c] + pivot_label * pivot_dot * paint[2, c]
                    )


@compiled(f4_3d, _PIXELS, const_f8_2d, const_i8_2d, const_f4_1d, f8, const_f8_2d)
def paint_bonds(
    canvas: Canvas,
    pixels: Pixels,
    rotors: Array,
    boxes: Boxes,
    paint: Canvas,
    width: float,
    moments: Array,
) -> None:
    """Paint bonds with the half width `width` [m] and one colour; see `paint_rotors`."""
    samples = moments.shape[1]
    masses = np.empty((samples, 4))
    for bond in range(len(boxes) - 1):
        left = min(boxes[bond, 0], boxes[bond + 1, 0])
        right = max(boxes[bond, 1], boxes[bond + 1, 1])
        top = min(boxes[bond, 2], boxes[bond + 1, 2])
        bottom = max(boxes[bond, 3], boxes[bond + 1, 3])
        for row in range(top, bottom):
            swept = 0.0
            for k in range(samples):
                for end in range(2):
                    across, up = mass_of(rotors, bond + end, moments[row, k])
                    masses[k, 2 * end] = rotors[3, bond + end] + across
                    masses[k, 2 * end + 1] = up
                    across = masses[k, 2 * end] - masses[0, 2 * end]
                    up = masses[k, 2 * end + 1] - masses[0, 2 * end + 1]
                    swept = max(swept, math.hypot(across, up))
            for column in range(left, right):
                x, z = pixels.x[row, column], pixels.z[row, column]
                spread = pixels.spread[row, column]
                across, up = masses[0, 2] - masses[0, 0], masses[0, 3] - masses[0, 1]
                from_first = from_arm(x - masses[0, 0], z - masses[0, 1], across, up)
                if from_first > width + swept + 4 * spread:
                    continue
                share = 0.0
                for k in range(samples):
                    across, up = masses[k, 2] - masses[k, 0], masses[k, 3] - masses[k, 1]
                    distance = from_arm(x - masses[k, 0], z - masses[k, 1], across, up)
                    share += covered(distance - width, spread)
                share /= samples
                for c in range(3):
                    canvas[row, column, c] += share * (paint[c] - canvas[row, column, c])


@compiled(f4_3d, const_f4_2d, const_f4_3d, i8, u1_3d)
def expose(
    canvas: Canvas, light: Canvas, noise: Canvas, shift: int, picture: NDArray[np.uint8]
) -> None:
    """Write to `picture` the canvas times `light`, plus `noise` shifted by `shift` columns."""
    height, width, colours = canvas.shape
    for row in range(height):
        for column in range(width):
            other = column + shift
            if other >= width:
                other -= width
            for c in range(colours):
                value = canvas[row, column, c] * light[row, column] + noise[row, other, c]
                picture[row, column, c] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
