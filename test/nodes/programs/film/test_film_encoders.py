# SPDX-License-Identifier: Apache-2.0
"""From a film with times of its own to a bag that is analysed, and markers of a file."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[3] / 'physics'))

from filmed_chains import CAMERA, renderer

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.vision.films.footage import Shot, read_film, write_film
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage_nodes.bags.read.reading import open_bag, read_topic
from soliton_linkage_nodes.camera_encoders.camera_file import read_camera, write_camera
from soliton_linkage_nodes.programs.film.film_encoders import main
from soliton_linkage_nodes.programs.film.marker_file import markers_of_file
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

CHAIN = """/**:
  ros__parameters:
    chain.number_of_rotors: 6
    markers.frame_columns: 2
"""
TIMES = np.array([0.0, 0.016, 0.034, 0.05, 0.1, 0.117])


def test_a_film_becomes_a_bag_with_its_own_times(tmp_path: Path) -> None:
    pytest.importorskip('cv2', reason='cameras need OpenCV')
    pytest.importorskip('av', reason='films need PyAV')
    _, film, motion = renderer(Chain(number_of_rotors=6))
    shots = [Shot(time, film.picture(time)) for time in TIMES]
    assert write_film(tmp_path / 'film.mp4', shots, quality=10, alone=True) == len(TIMES)
    (tmp_path / 'chain.yaml').write_text(CHAIN.replace('columns: 2', 'columns: 3'))
    write_camera(tmp_path / 'camera.yaml', CAMERA)
    given = ['--chain', str(tmp_path / 'chain.yaml'), '--output', str(tmp_path / 'bag')]
    given += ['--camera-info', str(tmp_path / 'camera.yaml')]
    given += ['--row-time', str(CAMERA.row_time), '--exposure', str(CAMERA.exposure)]
    main([str(tmp_path / 'film.mp4'), *given, '--overlay', str(tmp_path / 'overlay.mp4')])
    with open_bag(tmp_path / 'bag_0') as reader:
        frames = [message for _, message in read_topic(reader, 'joint_states')]
        deviations = [message for _, message in read_topic(reader, 'joint_state_deviations')]
        assert len(list(read_topic(reader, 'chain'))) == 1
    stamps = np.array([time_from_msg(frame.header.stamp) for frame in frames])
    assert (stamps - stamps[0]) / SECOND == pytest.approx(TIMES, abs=1e-4)
    truth = motion(TIMES + film.stamp(0.0))[0]
    angles = np.array([frame.position for frame in frames])
    assert np.abs(angles - truth).max() < 0.02
    assert len(deviations) == len(frames)
    overlay = list(read_film(tmp_path / 'overlay.mp4').pictures)
    assert [shot.time for shot in overlay] == pytest.approx(TIMES.tolist(), abs=1e-4)


def test_a_file_of_another_kind_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('cv2', reason='cameras need OpenCV')
    (tmp_path / 'chain.yaml').write_text(CHAIN)
    (tmp_path / 'film.mp4').write_bytes(b'no film')
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path / 'film.mp4'), '--chain', str(tmp_path / 'chain.yaml')])
    assert 'cannot be read' in str(ended.value.code)
    assert '\n' not in str(ended.value.code)


def test_markers_are_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / 'chain.yaml'
    path.write_text(CHAIN)
    assert markers_of_file(path).frame_columns == 2
    path.write_text(CHAIN.replace('frame_columns', 'columns'))
    with pytest.raises(ValueError, match=r'markers.columns is unknown; known: .*frame_columns'):
        markers_of_file(path)


def test_markers_stay_where_they_were_printed_for_another_chain(tmp_path: Path) -> None:
    path = tmp_path / 'chain.yaml'
    path.write_text(CHAIN)
    printed = markers_of_file(path)
    longer = Chain(6, deviations=Deviations(rotor_length=(0.1,) * 6, spacing=(0.1,) * 5))
    one, other = (MarkerLayout(chain, printed) for chain in (Chain(6), longer))
    assert other.frame_dots == pytest.approx(one.frame_dots)
    assert other.dot_radius == pytest.approx(one.dot_radius)


def test_a_calibration_comes_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / 'camera.yaml'
    write_camera(path, CAMERA)
    found = read_camera(path)
    assert (found.focal, found.centre, found.distortion) == (
        CAMERA.focal,
        CAMERA.centre,
        CAMERA.distortion,
    )
    path.write_text('image_width: 3')
    with pytest.raises(ValueError, match='is no calibration of a camera'):
        read_camera(path)
