# SPDX-License-Identifier: Apache-2.0
"""The camera in place of encoders: angles of the rotors from pictures of a chain."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.layout import MarkerSettings
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.overlay import draw_overlay
from soliton_linkage.vision.video import capture_camera
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages.camera_measurement import (
    CameraMeasurement,
    CameraParameters,
    CameraReading,
    angles_to_msg,
    describe_reading,
    deviations_to_msg,
    median_deviation,
    walls_on_overlay,
)
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    ChainSource,
    ChainSourceParameters,
)
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain, chain_to_msg
from soliton_linkage_nodes.messages.picture_conversions import (
    camera_from_msg,
    picture_from_compressed_msg,
    picture_from_msg,
    picture_to_compressed_msg,
    read_camera,
)
from soliton_linkage_nodes.messages.state_conversions import solitons_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription

_MOST_CAMERAS = 63
"""Largest number of a camera of Linux [1]."""
_FRESH = 1.0
"""Largest age of walls that are drawn [s]."""
_LONGEST_WAIT = 5.0
"""Longest wait for the end of the thread, which may be waiting for a picture [s]."""


@dataclass(frozen=True)
class CameraEncodersParameters:
    """Where the pictures come from."""

    pictures_from: str = quantity(
        'image',
        'whether pictures come from the topic image, from the topic image/compressed, or from a '
        'camera of this machine',
        choices=('image', 'compressed', 'camera'),
    )
    camera: int = quantity(0, 'number of the camera of this machine', '', 0, _MOST_CAMERAS)
    camera_file: str = quantity(
        '', 'path of a file of calibrate_camera, empty for what the topic camera_info says'
    )
    overlay_rate: float = quantity(
        20.0,
        'most pictures a second on camera_overlay, which are drawn while it is heard',
        'Hz',
        0.1,
        1000.0,
    )


class CameraEncoders(ManagedNode):
    """Publishes the angles of the rotors that pictures of a chain show, in place of encoders.

    Subscribes to `image` or `image/compressed`, unless it has a camera of this machine, to
    `camera_info`, unless it has a file of that, to `soliton_state`, for the walls that it draws,
    and, unless told the chain by parameters, to `chain`. Publishes `joint_states` [rad], NaN for
    rotors that are not seen, with the stamp of their exposure, `joint_state_deviations`, standard
    deviations of these angles in the place of positions [rad], `camera_overlay`, the pictures
    with what was found in them, while somebody subscribes to it, `/diagnostics` and, where it is
    told the chain by parameters, `chain` (latched).
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        CameraEncodersParameters: '',
        CameraParameters: '',
        MarkerSettings: 'markers.',
        ManagedParameters: '',
        ChainSourceParameters: '',
        **CHAIN_PARAMETERS,
    }

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('camera_encoders', **kwargs)

    @property
    def calibrated(self) -> bool:
        """Whether the lens of the camera is known."""
        return self._camera is not None

    def configure(self) -> None:
        """Learn the chain and the camera, and listen to its pictures."""
        opencv()
        self.settings = current(self, CameraEncodersParameters)
        self._markers = current(self, MarkerSettings, 'markers.')
        self._camera: Camera | None = None
        if self.settings.camera_file:
            self._camera = read_camera(Path(self.settings.camera_file))
        self._named: NamedChain | None = None
        self._sight: CameraMeasurement | None = None
        self._seen: CameraReading | None = None
        self._state: tuple[int, tuple[AnalysedSoliton, ...]] = (0, ())
        self._next_overlay = 0
        self._closing = threading.Event()
        self._webcam: threading.Thread | None = None
        self._pictures, self._busy = 0, 0.0
        self._reported = (time.monotonic(), 0, 0.0)
        self.diagnostics = Diagnostics(self, 'seeing', self.reporting(self._report))
        self._angles = interfaces.JOINT_STATES.publisher(self)
        self._deviations = interfaces.JOINT_STATE_DEVIATIONS.publisher(self)
        self._overlay = interfaces.CAMERA_OVERLAY.publisher(self)
        StreamSubscription(self, interfaces.SOLITON_STATE, self._on_state, self.diagnostics)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        if self._source.parameters.chain_from == 'parameters' and self._named is not None:
            stamp = self.get_clock().now().to_msg()
            interfaces.CHAIN.publisher(self).publish(chain_to_msg(self._named, stamp))
        self._listen()
        self.get_logger().info(f'seeing {self._source.description} in {self._whence()}')

    def activate(self) -> None:
        """Begin to take pictures, where they are those of a camera of this machine."""
        if self.settings.pictures_from == 'camera':
            self._closing = threading.Event()
            self._webcam = threading.Thread(target=self._film, name='camera', daemon=True)
            self._webcam.start()

    def deactivate(self) -> None:
        """Let the camera go, and look anew when it comes back."""
        if self._webcam is not None:
            self._closing.set()
            self._webcam.join(_LONGEST_WAIT)
            self._webcam = None
        self._look_anew()

    def look(self, stamp: int, picture: Picture) -> None:
        """Publish the angles in a picture that was begun at a stamp [ns], once it shows any.

        Raises ValueError for a picture that is refused.
        """
        if self._sight is None or self._named is None:
            return
        begin = time.perf_counter()
        seen = self._seen = self._sight.measure(stamp, picture)
        if seen.frame.seen:
            # Who takes the angles is to know by then how sure they are.
            self._deviations.publish(deviations_to_msg(self._named, seen))
            self._angles.publish(angles_to_msg(self._named, seen))
        self._draw(self._named, picture, seen)
        self._pictures += 1
        self._busy += time.perf_counter() - begin

    def _draw(self, named: NamedChain, picture: Picture, seen: CameraReading) -> None:
        """Publish an overlay if there is a subscriber and the period is over."""
        period = round(SECOND / self.settings.overlay_rate)
        if not self._overlay.get_subscription_count():
            return
        if 0 <= self._next_overlay - seen.stamp <= period:
            return
        self._next_overlay = seen.stamp + period
        stamp, solitons = self._state
        since = (seen.stamp - stamp) / SECOND
        walls = (
            walls_on_overlay(solitons, named.chain.spacing, since) if abs(since) < _FRESH else []
        )
        drawn = draw_overlay(picture, seen.frame, named.joint_names, walls)
        self._overlay.publish(picture_to_compressed_msg(seen.stamp, FRAME, drawn))

    def _film(self) -> None:
        """Take pictures of a camera of this machine until the node is deactivated: a thread."""
        closing, take = self._closing, self.diagnostics.guarded('picture', self.look)
        try:
            for taken in capture_camera(self.settings.camera):
                if closing.is_set():
                    return
                take(self.get_clock().now().nanoseconds, taken.picture)
        except ValueError as error:
            self.diagnostics.fail(str(error))

    def _listen(self) -> None:
        kind = self.settings.pictures_from
        topics = {'image': interfaces.IMAGE, 'compressed': interfaces.COMPRESSED_IMAGE}
        takes = {'image': self._on_image, 'compressed': self._on_compressed}
        if kind in topics:
            take = self.while_active(self.diagnostics.guarded('picture', takes[kind]))
            StreamSubscription(self, topics[kind], take, self.diagnostics)
            if self._camera is None:
                take = self.diagnostics.guarded('camera_info', self._on_camera_info)
                StreamSubscription(self, interfaces.CAMERA_INFO, take, self.diagnostics)

    def _on_image(self, message: Image) -> None:
        self.look(time_from_msg(message.header.stamp), picture_from_msg(message))

    def _on_compressed(self, message: CompressedImage) -> None:
        self.look(time_from_msg(message.header.stamp), picture_from_compressed_msg(message))

    def _on_state(self, message: SolitonState) -> None:
        self._state = time_from_msg(message.header.stamp), solitons_from_msg(message)

    def _on_camera_info(self, message: CameraInfo) -> None:
        camera = camera_from_msg(message)
        if camera is not None and camera != self._camera:
            self._camera = camera
            self._look_anew()

    def _on_chain(self, named: NamedChain) -> None:
        if named != self._named:
            self._named = named
            self._look_anew()

    def _look_anew(self) -> None:
        self._seen = None
        if self._named is not None:
            parameters = current(self, CameraParameters)
            self._sight = CameraMeasurement(self._named, self._markers, parameters, self._camera)

    def _whence(self) -> str:
        if self.settings.pictures_from == 'camera':
            return f'pictures of camera {self.settings.camera}'
        kind = self.settings.pictures_from
        topic = interfaces.IMAGE if kind == 'image' else interfaces.COMPRESSED_IMAGE
        return self.resolve_topic_name(topic.name)

    def _report(self) -> Report:
        now = time.monotonic()
        before, pictures_before, busy_before = self._reported
        self._reported = (now, self._pictures, self._busy)
        fresh = self._pictures - pictures_before
        values: dict[str, Any] = {
            'rate [Hz]': fresh / (now - before),
            'time per picture [ms]': 1e3 * (self._busy - busy_before) / max(fresh, 1),
            'pictures': self._pictures,
            'calibrated': self.calibrated,
        }
        if self._sight is None:
            return Report('waiting for the topic chain', values, warning=True)
        if self._seen is None or not fresh:
            return Report(f'waiting for {self._whence()}', values, warning=True)
        frame = self._seen.frame
        values |= {
            'rotors seen': frame.seen,
            'deviation [rad]': median_deviation(frame),
            'moves of the camera': self._sight.moves,
            'pictures missing': self._sight.gaps.missing,
        }
        return Report(
            describe_reading(self._sight, self._seen), values, warning=bool(frame.status)
        )


def main() -> None:
    """See angles until it is told to stop."""
    run(CameraEncoders)
