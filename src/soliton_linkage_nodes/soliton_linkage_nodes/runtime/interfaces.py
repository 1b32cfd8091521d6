# SPDX-License-Identifier: Apache-2.0
"""The topics of the suite: name, type and quality of service."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from soliton_linkage_msgs.msg import (
    Chain,
    Delivery,
    EdgeCommand,
    LastKick,
    RotorImpulses,
    SolitonEvent,
    SolitonState,
)

_DEEPEST_QUEUE = 1000
"""Messages: a second of a rotor chain at 1000 Hz, longer than any stall of a subscriber."""
_QUEUE_BYTES = 64 * 2**20
"""What the queues of a stream may take of the memory of each end."""
_LONGEST_RECORD = 100_000
"""Messages that may wait: 100 s at 1000 Hz; memory is taken for those that do."""
ACKNOWLEDGEMENT_LIMIT = 0.5
"""How long a node that goes waits until it was heard [s]: longer than a busy machine takes."""


def stream_qos(message_size: int = 0) -> QoSProfile:
    """Reliable and as deep as 64 MiB of messages allow, 10 to 1000: a stall loses nothing."""
    affordable = _QUEUE_BYTES // max(message_size, 1)
    depth = int(min(_DEEPEST_QUEUE, max(10, affordable)))
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def lossless_stream_qos() -> QoSProfile:
    """Reliable and so deep that nothing is lost where all of a record comes at once.

    Both ends need it: who publishes keeps what a subscriber that is busy does not yet have.
    """
    return QoSProfile(depth=_LONGEST_RECORD, reliability=ReliabilityPolicy.RELIABLE)


def command_qos() -> QoSProfile:
    """Reliable and volatile: a late joiner must not replay a kick."""
    return QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


def image_qos() -> QoSProfile:
    """Reliable and shallow: who shows a picture wants the newest."""
    return QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)


def latched_qos(depth: int = 1) -> QoSProfile:
    """Reliable and transient local: a late joiner gets the last messages."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def wait_for_acknowledgements(publisher: Publisher) -> None:
    """Wait, not for long, until those who listen have what was published: before a node goes."""
    publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGEMENT_LIMIT))


@dataclass(frozen=True)
class Topic:
    """One topic of the suite; its name is relative unless it begins with a slash."""

    name: str
    type: Any
    qos: QoSProfile

    @property
    def latched(self) -> bool:
        """Whether a late joiner gets the last message."""
        return bool(self.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    def publisher(self, node: Node) -> Publisher:
        """Publisher of a node on this topic."""
        return node.create_publisher(self.type, self.name, self.qos)

    def subscribe(self, node: Node, take: Callable[[Any], None], raw: bool = False) -> None:
        """Have a node take each message of this topic, or its CDR bytes where it is `raw`."""
        node.create_subscription(self.type, self.name, take, self.qos, raw=raw)


JOINT_STATES = Topic('joint_states', JointState, stream_qos())
NUDGE = Topic('nudge', Float64, command_qos())
EDGE_COMMAND = Topic('edge_command', EdgeCommand, command_qos())
JOINT_COMMANDS = Topic('joint_commands', JointState, command_qos())
EFFORT_COMMANDS = Topic('edge_actuator/commands', Float64MultiArray, command_qos())
JOINT_TRAJECTORY = Topic('edge_actuator/joint_trajectory', JointTrajectory, command_qos())
LAST_KICK = Topic('last_kick', LastKick, latched_qos())
DELIVERY = Topic('delivery', Delivery, latched_qos(_DEEPEST_QUEUE))
ROTOR_IMPULSES = Topic('rotor_impulses', RotorImpulses, command_qos())
DELIVERED_IMPULSES = Topic('delivered_impulses', RotorImpulses, command_qos())
ROTOR_TORQUES = Topic('rotor_torques', JointState, command_qos())
TILT = Topic('tilt', Float64, command_qos())
SOLITON_STATE = Topic('soliton_state', SolitonState, stream_qos())
SOLITON_EVENTS = Topic('soliton_events', SolitonEvent, stream_qos())
CHAIN = Topic('chain', Chain, latched_qos())
IDENTIFIED_CHAIN = Topic('identified_chain', Chain, latched_qos())
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, command_qos())
CLOCK = Topic('/clock', Clock, stream_qos())
ROBOT_DESCRIPTION = Topic('robot_description', String, latched_qos())
MARKERS = Topic('markers', MarkerArray, image_qos())
SOLITON_POSE = Topic('soliton_pose', PoseWithCovarianceStamped, image_qos())
KYMOGRAPH = Topic('kymograph', Image, image_qos())
JOINT_STATE_DEVIATIONS = Topic('joint_state_deviations', JointState, stream_qos())
IMAGE = Topic('image', Image, image_qos())
COMPRESSED_IMAGE = Topic('image/compressed', CompressedImage, image_qos())
CAMERA_INFO = Topic('camera_info', CameraInfo, image_qos())
CAMERA_OVERLAY = Topic('camera_overlay', CompressedImage, image_qos())
MOVE_SOLITON = 'move_soliton'
"""Name of the action."""

SUITE_TOPICS = (
    CHAIN,
    IDENTIFIED_CHAIN,
    JOINT_STATES,
    JOINT_STATE_DEVIATIONS,
    NUDGE,
    EDGE_COMMAND,
    JOINT_COMMANDS,
    EFFORT_COMMANDS,
    JOINT_TRAJECTORY,
    LAST_KICK,
    DELIVERY,
    DELIVERED_IMPULSES,
    ROTOR_IMPULSES,
    ROTOR_TORQUES,
    TILT,
    SOLITON_STATE,
    SOLITON_EVENTS,
    DIAGNOSTICS,
)
"""What the nodes say and hear, and bags hold."""
DISPLAY_TOPICS = (ROBOT_DESCRIPTION, MARKERS, SOLITON_POSE, KYMOGRAPH)
"""What is drawn of that for viewers; bags need not hold it."""
CAMERA_TOPICS = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, CAMERA_OVERLAY)
"""Of cameras in place of encoders."""


_POLL_INTERVAL = 0.02
"""Between two looks at who listens [s]: short to a person, long to a processor."""
_TIME_TO_MEET_ANOTHER = 1.0
"""Without a further subscriber, after which none is expected [s]: discovery takes less."""


def wait_for_subscriber(
    publisher: Publisher,
    seconds: float,
    stopping: threading.Event | None = None,
    fewest: int = 1,
) -> bool:
    """Wait until a topic has a subscriber, or as many as asked for.

    False where it has not in time, or is told to stop.

    Subscribers are met one after the other, so that after the first one it waits until no
    other has come for a second.
    """
    stopped = stopping or threading.Event()
    deadline = time.monotonic() + seconds
    met, met_at = 0, 0.0
    while met < fewest or time.monotonic() - met_at < _TIME_TO_MEET_ANOTHER:
        matched = publisher.get_subscription_count()
        if matched != met:
            met, met_at = matched, time.monotonic()
        elif met < fewest and time.monotonic() > deadline:
            return False
        if stopped.wait(_POLL_INTERVAL):
            return False
    return True
