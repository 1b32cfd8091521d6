# SPDX-License-Identifier: Apache-2.0
"""Measurement of the angles of a chain in the pictures of a live camera or a film."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.vision.angle_camera import AngleCamera, AngleFrame
from soliton_linkage.vision.camera import Camera, uncalibrated_camera
from soliton_linkage.vision.dark_rotors import DarkRotors
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.opencv import Picture
from soliton_linkage.vision.overlay import WallMark
from soliton_linkage.vision.video import GapCounter
from soliton_linkage_nodes.messages.conversions import NamedChain, joint_state
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg


@dataclass(frozen=True)
class CameraParameters:
    """Exposure settings of a camera, and whether the chain carries markers."""

    row_time: float = quantity(
        0.0,
        'time between the exposures of successive rows of the picture, 0 for a global shutter; '
        'about 2e-5 for a phone',
        's',
        0.0,
        1e-3,
    )
    exposure: float = quantity(0.0, 'exposure time of each row, 0 if unknown', 's', 0.0, 1.0)
    has_markers: bool = quantity(
        True,
        'whether pivots and masses carry markers; otherwise the rotors must be dark on a light '
        'background and must not touch',
    )


class CameraReading(NamedTuple):
    """Angles of the rotors in one picture."""

    stamp: int
    """Time of the angles [ns]: middle of the exposure of one picture row. This row is the mean row
    of the pivots. If the chain has no markers or its position in the picture is unknown, it is the
    middle row of the picture."""
    frame: AngleFrame


class CameraMeasurement:
    """Measurement of the angles of a chain in successive pictures."""

    def __init__(
        self,
        named: NamedChain,
        markers: MarkerSettings,
        parameters: CameraParameters,
        camera: Camera | None = None,
    ) -> None:
        self.gaps = GapCounter()
        self.detector: AngleCamera | DarkRotors | None = None
        """Detector of markers or of dark rotors. It is None before the first picture."""
        self._named, self._markers, self._parameters = named, markers, parameters
        self._camera = camera
        self._first: int | None = None
        self._last = -1

    @property
    def moves(self) -> int:
        """Number of times that the camera has moved; always 0 for a chain without markers."""
        return self.detector.frame_markers.moves if isinstance(self.detector, AngleCamera) else 0

    def measure(self, stamp: int, picture: Picture) -> CameraReading:
        """Return the angles of the rotors in a picture.

        `stamp` is the start of the exposure of the first picture row [ns]. Raises ValueError
        if the detector rejects the picture, or if `stamp` is not later than the stamp of the
        previous picture.
        """
        if stamp <= self._last:
            raise ValueError(
                f'its stamp is {(self._last - stamp) / SECOND:g} s before the previous stamp; '
                'publish pictures in the order of their stamps'
            )
        if self._first is None:
            self._first = stamp
        self._last = stamp
        if self.detector is None:
            self.detector = self._opened(picture)
        taken = (stamp - self._first) / SECOND
        self.gaps.add(taken)
        frame = self.detector.measure(taken, picture)
        return CameraReading(stamp + round(frame.delay * SECOND), frame)

    def _opened(self, picture: Picture) -> AngleCamera | DarkRotors:
        parameters = self._parameters
        height, width = picture.shape[:2]
        camera = self._camera or uncalibrated_camera(width, height)
        camera = replace(camera, row_time=parameters.row_time, exposure=parameters.exposure)
        layout = MarkerLayout(self._named.chain, self._markers)
        return (
            AngleCamera(layout, camera) if parameters.has_markers else DarkRotors(layout, camera)
        )


def angles_to_msg(named: NamedChain, seen: CameraReading) -> JointState:
    """Return the measured angles as joint states. The angles of hidden rotors are NaN."""
    return joint_state(named, time_to_msg(seen.stamp), position=seen.frame.angles)


def deviations_to_msg(named: NamedChain, seen: CameraReading) -> JointState:
    """Return joint states with the standard deviations of the angles in `position` [rad]."""
    return joint_state(named, time_to_msg(seen.stamp), position=seen.frame.deviations)


def describe_reading(measurement: CameraMeasurement, seen: CameraReading) -> str:
    """Describe the visible rotors, the moves of the camera and the number of missing pictures.

    Pictures count as missing if an interval between two stamps is unusually long.
    """
    parts = [seen.frame.status or 'all rotors are visible']
    if measurement.moves:
        times = 'once' if measurement.moves == 1 else f'{measurement.moves} times'
        parts.append(f'the camera has moved {times}')
    if measurement.gaps.missing:
        parts.append(f'{measurement.gaps.missing} pictures are missing')
    return '; '.join(parts)


def median_deviation(frame: AngleFrame) -> float:
    """Return the median standard deviation of the visible angles [rad]. Without any, it is NaN."""
    known = frame.deviations[np.isfinite(frame.deviations)]
    return float(np.median(known)) if len(known) else float('nan')


def walls_on_overlay(
    solitons: tuple[AnalysedSoliton, ...], spacing: float, since: float = 0.0
) -> list[WallMark]:
    """Return a mark for the position of each soliton.

    The velocity of the soliton is used to extrapolate the position to the time `since` after the
    state [s]. `spacing` is the distance between neighbouring pivots [m].
    """
    return [
        WallMark(
            each.rotor + (each.velocity * since / spacing if math.isfinite(each.velocity) else 0),
            each.position_deviation / spacing,
            int(each.charge),
        )
        for each in solitons
    ]
