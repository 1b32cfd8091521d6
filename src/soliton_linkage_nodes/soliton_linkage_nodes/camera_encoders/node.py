# SPDX-License-Identifier: Apache-2.0
"""Node that measures the angles of the rotors in camera pictures."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from sensor_msgs.msg import CameraInfo

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.layout import MarkerSettings
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.overlay import draw_overlay
from soliton_linkage.vision.video import capture_camera
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages import camera_measurement as measuring
from soliton_linkage_nodes.messages import picture_conversions as pictures
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS, ChainSource
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain
from soliton_linkage_nodes.messages.state_conversions import solitons_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription

_MOST_CAMERAS = 63
"""Largest device number of a camera on Linux [1], as in /dev/video63."""
_LONGEST_STATE_AGE = 1.0
"""Largest age of a `soliton_state` that is drawn into the pictures [s]."""
_STOP_LIMIT = 5.0
"""Longest wait for the end of the camera thread [s]. The thread may be waiting for a picture."""


@dataclass(frozen=True)
class CameraEncodersParameters:
    """Parameters of the source of the pictures and of the overlay."""

    pictures_from: str = quantity(
        'image',
        'source of the pictures: the topic image, the topic image/compressed, or a camera of this '
        'machine',
        choices=('image', 'compressed', 'camera'),
    )
    camera: int = quantity(0, 'number of the camera of this machine', '', 0, _MOST_CAMERAS)
    camera_file: str = quantity(
        '', 'path of a calibration by calibrate_camera; empty to use the topic camera_info'
    )
    overlay_rate: float = quantity(
        20.0,
        'largest rate of camera_overlay; pictures are drawn only while there is a subscriber',
        'Hz',
        0.1,
        1000.0,
    )


class CameraEncoders(ManagedNode):
    """Node that measures the angles of the rotors in camera pictures.

    The pictures come from a camera of this machine, from `image` or from `image/compressed`. The
    node also subscribes to `camera_info` and `soliton_state`. It publishes the angles in
    `joint_states` [rad]. Their stamp is `CameraReading.stamp`, a time in the middle of the
    exposure. The angles of hidden rotors are NaN. The node publishes the standard deviations of
    the angles in `joint_state_deviations` [rad], and it publishes `/diagnostics`. If
    `camera_overlay` has a subscriber, it publishes this topic. If parameters describe the chain,
    it publishes `chain`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        CameraEncodersParameters: '',
        measuring.CameraParameters: '',
        MarkerSettings: 'markers.',
        ManagedParameters: '',
        **CHAIN_SOURCE_PARAMETERS,
    }

    @property
    def calibrated(self) -> bool:
        """Whether the node has a calibration of the camera."""
        return self._camera is not None

    def configure(self) -> None:
        """Read the chain and the calibration, and create publishers and subscriptions."""
        opencv()
        self.settings = self.current(CameraEncodersParameters)
        self._markers = self.current(MarkerSettings)
        self._camera: Camera | None = None
        if self.settings.camera_file:
            self._camera = pictures.read_camera(Path(self.settings.camera_file))
        self._named: NamedChain | None = None
        self._measurement: measuring.CameraMeasurement | None = None
        self._reading: measuring.CameraReading | None = None
        self._state: tuple[int, tuple[AnalysedSoliton, ...]] = (0, ())
        self._next_overlay = 0
        self._closing = threading.Event()
        self._camera_thread: threading.Thread | None = None
        self._pictures, self._busy = 0, 0.0
        self._increments = Increments()
        self.diagnostics = Diagnostics(self, 'camera', self.reporting(self._report))
        self._angles = interfaces.JOINT_STATES.publisher(self)
        self._deviations = interfaces.JOINT_STATE_DEVIATIONS.publisher(self)
        self._overlay = interfaces.CAMERA_OVERLAY.publisher(self)
        StreamSubscription(self, interfaces.SOLITON_STATE, self._on_state, self.diagnostics)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        self._source.publish_parameters()
        self._pictures_name = self._subscribe_to_pictures()
        self.get_logger().info(f'measuring {self._source.description} in {self._pictures_name}')

    def activate(self) -> None:
        """Start the camera thread if the pictures come from a camera of this machine."""
        if self.settings.pictures_from == 'camera':
            self._closing = threading.Event()
            self._camera_thread = threading.Thread(
                target=self._read_camera, name='camera', daemon=True
            )
            self._camera_thread.start()

    def deactivate(self) -> None:
        """Release the camera and reset the measurement."""
        if self._camera_thread is not None:
            self._closing.set()
            self._camera_thread.join(_STOP_LIMIT)
            self._camera_thread = None
        self._reset_measurement()

    def measure(self, stamp: int, picture: Picture) -> None:
        """Publish the angles in a picture.

        `stamp` is the start of the exposure of the first picture row [ns]. This start is unknown
        for a camera of this machine. The later time at which the node received the picture is then
        used instead. Raises ValueError if the picture is rejected.
        """
        if self._measurement is None or self._named is None:
            return
        begin = time.perf_counter()
        reading = self._reading = self._measurement.measure(stamp, picture)
        if reading.frame.seen:
            # Publish the standard deviations first. Subscribers need them when the angles arrive.
            self._deviations.publish(measuring.deviations_to_msg(self._named, reading))
            self._angles.publish(measuring.angles_to_msg(self._named, reading))
        self._publish_overlay(self._named, picture, reading)
        self._pictures += 1
        self._busy += time.perf_counter() - begin

    def _publish_overlay(
        self, named: NamedChain, picture: Picture, reading: measuring.CameraReading
    ) -> None:
        period = round(SECOND / self.settings.overlay_rate)
        if not self._overlay.get_subscription_count():
            return
        if 0 <= self._next_overlay - reading.stamp <= period:
            return
        self._next_overlay = reading.stamp + period
        stamp, solitons = self._state
        age = (reading.stamp - stamp) / SECOND
        walls = (
            measuring.walls_on_overlay(solitons, named.chain.spacing, age)
            if abs(age) < _LONGEST_STATE_AGE
            else []
        )
        drawn = draw_overlay(picture, reading.frame, named.joint_names, walls)
        self._overlay.publish(pictures.picture_to_compressed_msg(reading.stamp, FRAME, drawn))

    def _read_camera(self) -> None:
        closing, take = self._closing, self.diagnostics.guarded('picture', self.measure)
        try:
            for taken in capture_camera(self.settings.camera):
                if closing.is_set():
                    return
                take(self.get_clock().now().nanoseconds, taken.picture)
        except ValueError as error:
            self.diagnostics.fail(str(error))

    def _subscribe_to_pictures(self) -> str:
        if self.settings.pictures_from == 'camera':
            return f'pictures of camera {self.settings.camera}'
        topic, picture_of = interfaces.IMAGE, pictures.picture_from_msg
        if self.settings.pictures_from == 'compressed':
            topic, picture_of = interfaces.COMPRESSED_IMAGE, pictures.picture_from_compressed_msg

        def measure(message: Any) -> None:
            self.measure(time_from_msg(message.header.stamp), picture_of(message))

        on_picture = self.while_active(self.diagnostics.guarded('picture', measure))
        StreamSubscription(self, topic, on_picture, self.diagnostics)
        if self._camera is None:
            on_info = self.diagnostics.guarded('camera_info', self._on_camera_info)
            StreamSubscription(self, interfaces.CAMERA_INFO, on_info, self.diagnostics)
        return self.resolve_topic_name(topic.name)

    def _on_state(self, message: SolitonState) -> None:
        self._state = time_from_msg(message.header.stamp), solitons_from_msg(message)

    def _on_camera_info(self, message: CameraInfo) -> None:
        camera = pictures.camera_from_msg(message)
        if camera is not None and camera != self._camera:
            self._camera = camera
            self._reset_measurement()

    def _on_chain(self, named: NamedChain) -> None:
        if named != self._named:
            self._named = named
            self._reset_measurement()

    def _reset_measurement(self) -> None:
        self._reading = None
        if self._named is not None:
            parameters = self.current(measuring.CameraParameters)
            self._measurement = measuring.CameraMeasurement(
                self._named, self._markers, parameters, self._camera
            )

    def _report(self) -> Report:
        seconds, new, busy = self._increments.take(self._pictures, self._busy)
        values: dict[str, Any] = {
            'rate [Hz]': new / seconds,
            'time per picture [ms]': 1e3 * busy / max(new, 1),
            'pictures': self._pictures,
            'calibrated': self.calibrated,
        }
        if self._measurement is None:
            return Report('waiting for the topic chain', values, warning=True)
        if self._reading is None or not new:
            return Report(f'waiting for {self._pictures_name}', values, warning=True)
        frame = self._reading.frame
        values |= {
            'rotors seen': frame.seen,
            'deviation [rad]': measuring.median_deviation(frame),
            'moves of the camera': self._measurement.moves,
            'pictures missing': self._measurement.gaps.missing,
        }
        return Report(
            measuring.describe_reading(self._measurement, self._reading),
            values,
            bool(frame.status),
        )
