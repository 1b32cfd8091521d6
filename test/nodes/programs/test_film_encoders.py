# SPDX-License-Identifier: Apache-2.0
"""A film with its own time stamps becomes a bag for the analyser; markers come from a file."""

import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

sys.path.append(str(Path(__file__).parents[2] / 'physics'))

from filmed_chains import CAMERA, renderer, swinging

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.video import TimedPicture, read_video, write_video
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.recovery import check_bag
from soliton_linkage_nodes.messages.chain_source import markers_of_file
from soliton_linkage_nodes.messages.picture_conversions import read_camera, write_camera
from soliton_linkage_nodes.programs.film_encoders import main
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_studies.camera.renderer import Renderer

CHAIN = """/**:
  ros__parameters:
    chain.number_of_rotors: 6
    markers.frame_columns: 2
"""
TIMES = np.array([0.0, 0.016, 0.034, 0.05, 0.1, 0.117])


@pytest.fixture(scope='module')
def film():
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    return renderer(Chain(number_of_rotors=6))[1]


def given(film: Renderer, folder: Path) -> list[str]:
    """Arguments of the program, whose film, chain and camera are in a folder."""
    shots = [TimedPicture(time, film.picture(time)) for time in TIMES]
    assert write_video(folder / 'film.mp4', shots, quality=10, alone=True) == len(TIMES)
    (folder / 'chain.yaml').write_text(CHAIN.replace('columns: 2', 'columns: 3'))
    write_camera(folder / 'camera.yaml', CAMERA)
    names = {'--chain': 'chain.yaml', '--camera-info': 'camera.yaml', '--output': 'bag'}
    names['--overlay'] = 'overlay.mp4'
    paths = [each for key, name in names.items() for each in (key, str(folder / name))]
    times = ['--row-time', str(CAMERA.row_time), '--exposure', str(CAMERA.exposure)]
    return [str(folder / 'film.mp4'), *paths, *times]


def test_a_film_becomes_a_bag_with_its_own_times(film, tmp_path):
    motion = swinging(Chain(number_of_rotors=6), 0.15, 12.0)
    main(given(film, tmp_path))
    with open_bag(tmp_path / 'bag_0') as reader:
        frames = [message for _, message in read_topic(reader, 'joint_states')]
        deviations = [message for _, message in read_topic(reader, 'joint_state_deviations')]
        assert len(list(read_topic(reader, 'chain'))) == 1
    with AnyReader([tmp_path / 'bag_0']) as strict:
        for connection, _, serialized in strict.messages():
            strict.deserialize(serialized, connection.msgtype)
    stamps = np.array([time_from_msg(frame.header.stamp) for frame in frames])
    assert (stamps - stamps[0]) / SECOND == pytest.approx(TIMES, abs=1e-4)
    truth = motion(TIMES + film.stamp(0.0))[0]
    angles = np.array([frame.position for frame in frames])
    assert np.abs(angles - truth).max() < 0.02
    assert len(deviations) == len(frames)
    overlay = list(read_video(tmp_path / 'overlay.mp4').pictures)
    assert [shot.time for shot in overlay] == pytest.approx(TIMES.tolist(), abs=1e-4)


def test_frames_before_the_damage_of_a_film_are_in_the_bag_with_a_note(film, tmp_path):
    arguments = given(film, tmp_path)
    path = tmp_path / 'film.mp4'
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) * 2 // 3] = bytes(len(data) * 2 // 3 - len(data) // 2)
    path.write_bytes(data)
    with pytest.raises(SystemExit, match=r"film\.mp4' is damaged after 0\.0\d s"):
        main(arguments)
    report = check_bag(tmp_path / 'bag_0')
    assert not report.damage
    assert 'is damaged after 0.0' in report.custom_data['ended_by']
    seen = next(count for topic, count in report.counts.items() if topic.name == '/joint_states')
    overlay = list(read_video(tmp_path / 'overlay.mp4').pictures)
    assert 0 < seen == len(overlay) < len(TIMES)


def test_markers_are_those_of_the_file(tmp_path):
    path = tmp_path / 'chain.yaml'
    path.write_text(CHAIN)
    assert markers_of_file(path).frame_columns == 2
    path.write_text(CHAIN.replace('frame_columns', 'columns'))
    with pytest.raises(ValueError, match=r'markers.columns is unknown; known: .*frame_columns'):
        markers_of_file(path)


def test_markers_stay_where_they_were_printed_for_another_chain(tmp_path):
    path = tmp_path / 'chain.yaml'
    path.write_text(CHAIN)
    printed = markers_of_file(path)
    longer = Chain(6, deviations=Deviations(rotor_length=(0.1,) * 6, spacing=(0.1,) * 5))
    one, other = (MarkerLayout(chain, printed) for chain in (Chain(6), longer))
    assert other.frame_dots == pytest.approx(one.frame_dots)
    assert other.dot_radius == pytest.approx(one.dot_radius)


def test_a_calibration_comes_back_from_its_file(tmp_path):
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
