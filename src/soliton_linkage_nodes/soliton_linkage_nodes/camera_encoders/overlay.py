# SPDX-License-Identifier: Apache-2.0
"""The camera's picture with what was found in it, for who looks at it."""

from __future__ import annotations

import math

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.overlay import PlacedWall, overlaid
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.camera_encoders.sight import Seen
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain
from soliton_linkage_nodes.messages.picture_conversions import picture_to_compressed_msg
from soliton_linkage_nodes.messages.soliton_conversions import solitons_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.adaptive_subscription import AdaptiveSubscription
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics
from soliton_linkage_nodes.runtime.intake.guarded import GuardedNode
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_FRESH = 1.0
"""Age beyond which walls are not those of the picture any more [s]."""


class Overlay:
    """Publishes pictures with what was found in them, while somebody subscribes to them."""

    def __init__(self, node: GuardedNode, diagnostics: Diagnostics, rate: float) -> None:
        """Publish so many a second at most [Hz], with the walls that `soliton_state` tells."""
        self._cv2 = opencv()
        self._period = round(SECOND / rate)
        self._publisher = interfaces.CAMERA_OVERLAY.publisher(node)
        self._state: tuple[int, tuple[AnalysedSoliton, ...]] = (0, ())
        self._next = 0
        AdaptiveSubscription(node, interfaces.SOLITON_STATE, self._take, diagnostics)

    def draw(self, named: NamedChain, picture: Picture, seen: Seen) -> None:
        """Publish a picture, where one is wanted by now."""
        if not self._publisher.get_subscription_count():
            return
        if 0 <= self._next - seen.stamp <= self._period:
            return
        self._next = seen.stamp + self._period
        stamp, solitons = self._state
        since = (seen.stamp - stamp) / SECOND
        walls = placed(solitons, named.chain.spacing, since) if abs(since) < _FRESH else []
        drawn = overlaid(picture, seen.frame, named.joint_names, walls)
        self._publisher.publish(picture_to_compressed_msg(self._cv2, seen.stamp, FRAME, drawn))

    def _take(self, message: SolitonState) -> None:
        self._state = time_from_msg(message.header.stamp), solitons_from_msg(message)


def placed(
    solitons: tuple[AnalysedSoliton, ...], spacing: float, since: float = 0.0
) -> list[PlacedWall]:
    """Walls of a chain of a spacing [m] where they will be after a time [s]."""
    return [
        PlacedWall(
            each.rotor + (each.velocity * since / spacing if math.isfinite(each.velocity) else 0),
            each.position_deviation / spacing,
            int(each.charge),
        )
        for each in solitons
    ]
