# SPDX-License-Identifier: Apache-2.0
"""Stated errors of angles agree with the errors by displaced frame markers."""

from dataclasses import replace

import numpy as np
import pytest
from filmed_chains import CAMERA, chain_plane, renderer

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.vision.frame_markers import FrameMarkers, PlacingErrors
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.plane import fit_plane
from soliton_linkage_studies.camera.renderer import FilmSettings

pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')


def test_errors_by_displaced_markers_agree_with_the_stated_deviations():
    layout = MarkerLayout(Chain(number_of_rotors=10))
    plane, random, tolerance = chain_plane(layout), np.random.default_rng(6), 5e-4
    dots = layout.frame_dots
    pivots = np.column_stack([layout.chain.pivots, np.zeros(10)])
    angles = random.uniform(-3.0, 3.0, 10)
    arms = layout.chain.rotor_lengths.max() * np.column_stack([np.sin(angles), np.cos(angles)])
    ends = plane.pixels(np.stack([pivots, pivots + arms]))
    errors = []
    for _ in range(400):
        moved = dots + tolerance * random.standard_normal((len(dots), 1, 2))
        fitted, _ = fit_plane(CAMERA, dots.reshape(-1, 2), plane.pixels(moved.reshape(-1, 2)))
        seen = np.subtract(*fitted.points(ends)[::-1])
        errors.append(np.arctan2(seen[:, 0], seen[:, 1]) - angles)
    markers = np.repeat(np.arange(len(dots)), 4)
    stated = tolerance * PlacingErrors(dots.reshape(-1, 2), markers).deviations(pivots, arms)
    assert np.sqrt(np.mean(np.square(errors), axis=0)) == pytest.approx(stated, rel=0.15)
    assert np.sqrt(np.mean(np.square(errors / stated))) == pytest.approx(1.0, abs=0.07)


def test_displaced_markers_do_not_count_as_errors_of_fitted_dots():
    chain, random = Chain(number_of_rotors=8), np.random.default_rng(4)
    layout, film, _ = renderer(chain, settings=FilmSettings(noise=0.0))
    grey, errors = film.picture(0.0)[..., 1].copy(), []
    for _ in range(6):
        x, z = (
            layout.frame_centres + 5e-4 * random.standard_normal((len(layout.frame_dots), 2))
        ).T
        stated = replace(layout.settings, frame_x=tuple(x.tolist()), frame_z=tuple(z.tolist()))
        markers = FrameMarkers(MarkerLayout(chain, stated), CAMERA)
        assert markers.update(grey)
        errors.append(markers.fit_error)
    assert np.sqrt(np.mean(np.square(errors))) < 0.02
