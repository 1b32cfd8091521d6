# SPDX-License-Identifier: Apache-2.0
"""Colours of all pictures: the palette of Okabe and Ito, suitable for colour-blind readers."""

from __future__ import annotations

BLACK = '#000000'
GREY = '#7f7f7f'
PALE = '#d9d9d9'
DARK = '#3a3a3a'
BLUE = '#0072b2'
SKY = '#56b4e9'
RED = '#d55e00'
ORANGE = '#e69f00'
GREEN = '#009e73'
PURPLE = '#cc79a7'
WHITE = '#ffffff'


def shares(colour: str) -> tuple[float, float, float]:
    """Return the red, green and blue components of a colour such as '#d55e00', from 0 to 1."""
    red, green, blue = (int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5))
    return red, green, blue
