# SPDX-License-Identifier: Apache-2.0
"""Rendered films of chains with a known motion."""

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.plane import ChainPlane
from soliton_linkage_studies.camera.renderer import (
    FilmSettings,
    Hand,
    Motion,
    Renderer,
    posed_plane,
)

LENS = (-0.12, 0.05, 0.0005, -0.0003, 0.0)
CAMERA = Camera(640, 360, (560.0, 560.0), (318.6, 181.2), LENS, row_time=25e-6, exposure=0.004)
PERIOD = 1 / 60


def swinging(chain: Chain, amplitude: float, rate: float) -> Motion:
    """Return a motion in which all rotors swing around the uniform state."""
    rest, sides = chain.uniform_state(1), (-1.0) ** np.arange(chain.number_of_rotors)

    def motion(times: Array) -> tuple[Array, Array, Array]:
        turns = rate * times[:, None]
        swing = amplitude * sides * np.sin(turns)
        return rest + swing, amplitude * rate * sides * np.cos(turns), -(rate**2) * swing

    return motion


def chain_plane(layout: MarkerLayout, camera: Camera = CAMERA, near: float = 1.0) -> ChainPlane:
    """Return the plane of a chain that fills the picture, seen obliquely."""
    length = float(layout.chain.pivots[-1])
    seen = length + 2 * layout.frame_marker_size + layout.paper_size
    distance = near * 1.1 * seen * camera.focal[0] / camera.width
    return posed_plane(camera, (length / 2, 0.0), distance, 0.06, -0.09, 0.01)


def exact_layout(chain: Chain) -> MarkerLayout:
    """Return the layout of a rendered film, which has no error of the positions."""
    return MarkerLayout(chain, MarkerSettings(placing_tolerance=0.0))


def renderer(
    chain: Chain,
    amplitude: float = 0.15,
    rate: float = 12.0,
    settings: FilmSettings | None = None,
    hands: tuple[Hand, ...] = (),
) -> tuple[MarkerLayout, Renderer, Motion]:
    layout = exact_layout(chain)
    motion = swinging(chain, amplitude, rate)
    given = FilmSettings() if settings is None else settings
    return layout, Renderer(layout, chain_plane(layout), motion, given, hands), motion
