# SPDX-License-Identifier: Apache-2.0
"""From pictures with stamps to joint states: the one way of the node and of films."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.angle_camera import AngleCamera, AngleFrame
from soliton_linkage.vision.camera import Camera, uncalibrated
from soliton_linkage.vision.dark_rotors import DarkRotors
from soliton_linkage.vision.footage import GapWatch
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.opencv import Picture
from soliton_linkage_nodes.camera_encoders.parameters import SightParameters
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg


class Seen(NamedTuple):
    """What a picture shows."""

    stamp: int
    """Of the angles, the middle of the exposure of the row with the pivots [ns]."""
    frame: AngleFrame


class Sight:
    """Sees the angles of a chain in pictures."""

    def __init__(
        self,
        named: NamedChain,
        markers: MarkerSettings,
        parameters: SightParameters,
        camera: Camera | None = None,
    ) -> None:
        """Look through a camera that was calibrated, or, without one, through an ideal lens."""
        self.gaps = GapWatch()
        """Counts pictures that did not come."""
        self.eye: AngleCamera | DarkRotors | None = None
        """What sees the angles, once there was a picture."""
        self._named, self._markers, self._parameters = named, markers, parameters
        self._camera = camera
        self._first: int | None = None
        self._last = -1

    @property
    def moves(self) -> int:
        """How often the camera has moved."""
        return self.eye.frame_markers.moves if isinstance(self.eye, AngleCamera) else 0

    def look(self, stamp: int, picture: Picture) -> Seen:
        """Angles in a picture that was begun at a stamp [ns], blue, green and red or grey.

        Raises ValueError for a picture that is not later than the one before, or not of the size
        that the camera was calibrated with.
        """
        if stamp <= self._last:
            raise ValueError(
                f'its stamp is {(self._last - stamp) / SECOND:g} s before that of the picture '
                'before; send pictures in the order in which they were taken'
            )
        if self._first is None:
            self._first = stamp
        self._last = stamp
        if self.eye is None:
            self.eye = self._opened(picture)
        taken = (stamp - self._first) / SECOND
        self.gaps.look(taken)
        frame = self.eye.look(taken, picture)
        return Seen(stamp + round(frame.delay * SECOND), frame)

    def _opened(self, picture: Picture) -> AngleCamera | DarkRotors:
        told = self._parameters
        height, width = picture.shape[:2]
        camera = self._camera or uncalibrated(width, height)
        camera = dataclasses.replace(camera, row_time=told.row_time, exposure=told.exposure)
        layout = MarkerLayout(self._named.chain, self._markers)
        return AngleCamera(layout, camera) if told.markers_worn else DarkRotors(layout, camera)


def angles_to_msg(named: NamedChain, seen: Seen) -> JointState:
    """Angles as joint states; those of rotors that are not seen are NaN."""
    return _to_msg(named, seen.stamp, seen.frame.angles)


def deviations_to_msg(named: NamedChain, seen: Seen) -> JointState:
    """Standard deviations of the angles [rad], as positions, with the stamp of the angles."""
    return _to_msg(named, seen.stamp, seen.frame.deviations)


def in_words(sight: Sight, seen: Seen) -> str:
    """What a picture shows, in a sentence."""
    told = [seen.frame.status or 'all rotors are seen']
    if sight.moves:
        times = 'once' if sight.moves == 1 else f'{sight.moves} times'
        told.append(f'the camera has moved {times}')
    if sight.gaps.missing:
        told.append(f'{sight.gaps.missing} pictures are missing')
    return '; '.join(told)


def median_deviation(frame: AngleFrame) -> float:
    """Median of the standard deviations of what is seen [rad], NaN where nothing is."""
    known = frame.deviations[np.isfinite(frame.deviations)]
    return float(np.median(known)) if len(known) else float('nan')


def _to_msg(named: NamedChain, stamp: int, values: Array) -> JointState:
    return JointState(
        header=Header(stamp=time_to_msg(stamp), frame_id=FRAME),
        name=list(named.joint_names),
        position=values.tolist(),
    )
