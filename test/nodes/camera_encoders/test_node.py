# SPDX-License-Identifier: Apache-2.0
import array
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

sys.path.append(str(Path(__file__).parents[2] / 'physics'))

from filmed_chains import CAMERA, PERIOD, renderer

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.camera_encoders.node import CameraEncoders
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.messages.picture_conversions import picture_from_compressed_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg

CHAIN = Chain(number_of_rotors=6)
START = 1_000_000_000 * SECOND


def image(stamp: int, picture: np.ndarray) -> Image:
    height, width, _ = picture.shape
    return Image(
        header=Header(stamp=time_to_msg(stamp), frame_id='camera'),
        height=height,
        width=width,
        encoding='bgr8',
        step=3 * width,
        data=array.array('B', picture.tobytes()),
    )


def info() -> CameraInfo:
    (fx, fy), (cx, cy) = CAMERA.focal, CAMERA.centre
    return CameraInfo(
        width=CAMERA.width,
        height=CAMERA.height,
        distortion_model='plumb_bob',
        d=list(CAMERA.distortion),
        k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
    )


def test_pictures_become_joint_states_with_deviations(graph):
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    parameters: dict[str, Any] = {
        'chain_from': 'parameters',
        'chain.number_of_rotors': CHAIN.number_of_rotors,
        'row_time': CAMERA.row_time,
        'exposure': CAMERA.exposure,
    }
    chains = graph.hear(interfaces.CHAIN)
    node = graph.start(CameraEncoders, parameters)
    angles = graph.hear(interfaces.JOINT_STATES)
    deviations = graph.hear(interfaces.JOINT_STATE_DEVIATIONS)
    overlays = graph.hear(interfaces.CAMERA_OVERLAY)
    _, film, motion = renderer(CHAIN)
    infos, images = graph.speak(interfaces.CAMERA_INFO), graph.speak(interfaces.IMAGE)
    infos.publish(info())
    graph.until(lambda: node.calibrated, 'the calibration')
    for frame in range(4):
        time = frame * PERIOD
        images.publish(image(START + round(time * SECOND), film.picture(time)))
        graph.until(lambda count=frame + 1: len(angles) == count, 'the angles in a picture')
    graph.until(lambda: len(deviations) == len(angles), 'the deviations of the angles')
    last: JointState = angles[-1]
    truth = motion(np.array([(time_from_msg(last.header.stamp) - START) / SECOND]))[0][0]
    assert list(last.name) == [f'rotor_{rotor}' for rotor in range(6)]
    assert np.abs(np.array(last.position) - truth).max() < 0.01
    assert deviations[-1].header.stamp == last.header.stamp
    assert (np.array(deviations[-1].position) < 0.01).all()
    graph.until(lambda: bool(chains), 'the topic chain')
    assert chain_from_msg(chains[0]).chain == CHAIN
    graph.until(lambda: bool(overlays), 'an overlay')
    drawn = picture_from_compressed_msg(overlays[-1])
    assert drawn.shape == (CAMERA.height, CAMERA.width, 3)
