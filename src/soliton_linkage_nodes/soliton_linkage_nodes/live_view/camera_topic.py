# SPDX-License-Identifier: Apache-2.0
"""The newest picture of the camera at a chain, while a page shows it."""

from __future__ import annotations

import math
import time

from rclpy.node import Node

from soliton_linkage_nodes.live_view.frame_layout import pack_camera
from soliton_linkage_nodes.messages.picture_conversions import jpeg_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, newest_of

_MOST_BYTES = 4_000_000
"""Of a picture that is passed on: a sharp one of 12 million pixels; each browser is sent each."""


class CameraTopic:
    """`camera_overlay` of a namespace, to which it subscribes only while that is wanted."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Subscribe to nothing yet; the namespace ends in a slash."""
        self.pictures = 0
        """How many came since it was wanted."""
        self._node = node
        self._name = f'{namespace}{interfaces.CAMERA_OVERLAY.name}'
        self._publishers = 0
        self._newest: AdaptiveSubscription | None = None
        self._jpeg = b''
        self._stamp = math.nan
        self._came = -math.inf
        self._complaint = ''

    @property
    def reason(self) -> str:
        """Why there is no picture, empty where there may be one."""
        if self._complaint or self._publishers:
            return self._complaint
        return f'nothing publishes {interfaces.CAMERA_OVERLAY.name}: start camera_encoders'

    def want(self, wanted: bool) -> None:
        """Listen as long as somebody looks; the publisher, too, works only then."""
        if wanted and self._publishers and self._newest is None:
            self._newest = newest_of(self._node, interfaces.CAMERA_OVERLAY, self._name)
        elif not wanted and self._newest is not None:
            self.close()

    def take(self) -> None:
        """Keep the newest picture, where one has come."""
        message = self._newest.newest() if self._newest else None
        if message is None:
            return
        try:
            self._jpeg = jpeg_from_msg(message, _MOST_BYTES)
        except ValueError as error:
            self._complaint = f'{interfaces.CAMERA_OVERLAY.name}: {error}'
            return
        self._complaint = ''
        self._stamp = time_from_msg(message.header.stamp) / SECOND
        self._came = time.monotonic()
        self.pictures += 1

    def adapt(self) -> None:
        """See who publishes, and hear them whatever they offer."""
        if self._newest is not None:
            self._newest.adapt()
            self._publishers = len(self._newest.publishers)
        else:
            self._publishers = self._node.count_publishers(self._name)
        if not self._publishers:
            self._complaint = ''

    def picture(self, number: int) -> bytes:
        """The newest picture, for a page, of the chain of a number in the list."""
        return pack_camera(number, self._stamp, time.monotonic() - self._came, self._jpeg)

    def close(self) -> None:
        """Listen no longer, and forget what is old by the time that somebody looks again."""
        if self._newest is not None:
            self._newest.close()
        self._newest, self._jpeg, self.pictures = None, b'', 0
