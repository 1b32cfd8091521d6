# SPDX-License-Identifier: Apache-2.0
"""Processor time of one core to measure the angles in a picture of 1280 x 720 pixels.

The time depends on the number of dots and on the area of a dot, because every pixel of a dot is
fitted. Few rotors fill the picture with larger dots, and thus need as much time as many rotors.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.vision.angle_camera import AngleCamera
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.opencv import opencv
from soliton_linkage_studies.camera.renderer import FilmSettings, Renderer
from soliton_linkage_studies.camera.runs import (
    CAMERA,
    PERIOD,
    SIMULATED,
    chain_plane,
    interpolate_motion,
)
from soliton_linkage_studies.experiments import record_kick

ROTORS = 6, 12, 24, 40
SETTLING = 10
"""Number of first pictures that are not counted [1], because the markers are searched in them."""


def measure(rotors: int, pictures: int) -> tuple[float, float, float]:
    """Return the radius of a dot [pixels], and median and largest time per picture [s]."""
    chain = Chain(number_of_rotors=rotors)
    frames = round((pictures + SETTLING + 4) * PERIOD / SIMULATED)
    motion = interpolate_motion(
        record_kick(chain, 0.1, frames * SIMULATED / chain.time_unit, frames)
    )
    layout = MarkerLayout(chain)
    plane = chain_plane(layout)
    film = Renderer(layout, plane, motion, FilmSettings())
    eye = AngleCamera(layout, CAMERA)
    busy = []
    for number in range(2, pictures + SETTLING + 2):
        picture = film.picture(number * PERIOD)
        before = time.process_time()
        seen = eye.measure(number * PERIOD, picture)
        busy.append(time.process_time() - before)
        assert seen.seen, seen.status
    scale = float(np.median(plane.pixels_per_metre(eye.pivots.positions)))
    return layout.dot_radius * scale, float(np.median(busy[SETTLING:])), max(busy[SETTLING:])


def main() -> None:
    """Print a table, one row per number of rotors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--pictures', type=int, default=120, help='per number of rotors (120)')
    pictures = parser.parse_args().pictures
    opencv().setNumThreads(1)
    print('| flippers | radius of a dot [pixels] | median [ms] | largest [ms] | pictures/s |')
    print('| --- | --- | --- | --- | --- |')
    for rotors in ROTORS:
        radius, median, largest = measure(rotors, pictures)
        print(
            f'| {rotors} | {radius:.1f} | {1e3 * median:.1f} | {1e3 * largest:.1f} | '
            f'{1 / median:.0f} |'
        )


if __name__ == '__main__':
    main()
