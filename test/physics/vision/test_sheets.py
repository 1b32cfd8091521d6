# SPDX-License-Identifier: Apache-2.0
"""Sheets are to scale, and printed frame markers are detected."""

import re
from dataclasses import replace

import numpy as np
import pytest
from filmed_chains import CAMERA, chain_plane, renderer, swinging

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.vision.angle_camera import AngleCamera
from soliton_linkage.vision.camera import uncalibrated_camera
from soliton_linkage.vision.frame_markers import FrameMarkers
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.sheets import write_sheets
from soliton_linkage_studies.camera.renderer import Renderer

pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
CHAIN = Chain(number_of_rotors=8)


def test_sheets_have_the_size_of_the_paper_and_all_markers(tmp_path):
    paths = write_sheets(MarkerLayout(CHAIN), tmp_path / 'markers.svg')
    texts = [path.read_text(encoding='utf-8') for path in paths]
    width = float(re.findall(r'<svg[^>]* width="([\d.]+)pt"', texts[0])[0])
    assert width == pytest.approx(210 / 25.4 * 72, abs=0.1)
    assert len(paths) == len(MarkerLayout(CHAIN).frame_centres) + 1 + 1 + 1


def test_frame_markers_have_their_centres_on_whole_millimetres():
    for spacing in [0.0123, 0.05, 0.0757, 0.1]:
        for rotors in [2, 7, 40]:
            for columns in range(2, 6):
                chain = Chain(
                    number_of_rotors=rotors, spacing=spacing, rotor_length=0.437 * spacing
                )
                layout = MarkerLayout(chain, MarkerSettings(frame_columns=columns))
                centres = 1e3 * layout.frame_centres
                np.testing.assert_allclose(centres, np.round(centres), atol=1e-9)
                papers = np.abs(layout.frame_centres[:, None] - layout.frame_centres).max(axis=-1)
                assert (papers + np.eye(len(centres)) > layout.paper_size).all()
                clear = np.abs(layout.frame_centres[:, 1]).min() - layout.paper_size / 2
                assert clear > layout.bounds[1, 1]


def test_a_sheet_has_all_digits_of_the_position_of_a_marker(tmp_path):
    settings = MarkerSettings(frame_x=(0.0, 0.35), frame_z=(0.1875, -0.1875))
    layout = MarkerLayout(Chain(number_of_rotors=4), settings)
    paths = write_sheets(layout, tmp_path / 'markers.svg')
    texts = [path.read_text(encoding='utf-8') for path in paths]
    assert 'centre at x = 350 mm, z = -187.5 mm' in ''.join(texts)


def test_markers_larger_than_the_paper_are_rejected(tmp_path):
    layout = MarkerLayout(CHAIN, MarkerSettings(frame_marker_size=0.3))
    with pytest.raises(ValueError, match=r'frame markers of 390 mm do not fit on a4.*a3'):
        write_sheets(layout, tmp_path / 'markers.pdf')


@pytest.mark.parametrize('scale', [0.94, 1.0, 1.05])
def test_a_print_of_another_scale_is_reported(scale):
    layout = MarkerLayout(CHAIN)
    given = layout.as_printed
    sizes = {key: scale * getattr(given, key) for key in ('frame_marker_size', 'label_diameter')}
    scaled = MarkerLayout(CHAIN, replace(given, **sizes))
    film = Renderer(scaled, chain_plane(layout), swinging(CHAIN, 0.1, 1.0))
    camera = AngleCamera(layout, CAMERA)
    frame = camera.measure(0.0, film.picture(0.0))
    assert camera.frame_markers.print_scale == pytest.approx(scale, abs=0.005)
    assert (f'frame markers have {scale:.0%} of their size' in frame.status) is (scale != 1)


def test_frame_markers_define_the_plane():
    layout, film, _ = renderer(CHAIN)
    markers = FrameMarkers(layout, CAMERA)
    grey = film.picture(0.0)[..., 1].copy()
    assert markers.update(grey)
    assert markers.seen == 4 * len(layout.frame_centres)
    found = markers.plane
    assert found is not None
    points = layout.frame_centres
    places = found.pixels(points)
    assert np.allclose(found.points(places), points, atol=1e-6)
    assert not FrameMarkers(layout, uncalibrated_camera(640, 360)).update(np.zeros_like(grey))


def test_a_slow_motion_of_the_frame_is_followed_after_a_thousand_pictures():
    layout, film, _ = renderer(CHAIN)
    markers = FrameMarkers(layout, CAMERA)
    grey = film.picture(0.0)[..., 1].copy()
    beside = np.round(0.93 * grey + 0.07 * np.roll(grey, 1, axis=1)).astype(grey.dtype)
    for _ in range(1001):
        markers.update(grey)
    assert markers.plane is not None
    before = markers.plane.pixels(layout.frame_centres)
    for _ in range(60):
        markers.update(beside)
    shift = markers.plane.pixels(layout.frame_centres) - before
    # The weight of a picture is 1/1000, and the plane is fitted every 30 pictures.
    assert 0.07 * 0.02 < shift[:, 0].mean() < 0.07 * 0.07
    assert markers.moves == 0
