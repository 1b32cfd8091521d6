# SPDX-License-Identifier: Apache-2.0
"""Topics of the suite, with their names, types and quality of service."""

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
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from soliton_linkage_msgs import msg

_DEEPEST_QUEUE = 1000
"""Largest queue depth of a stream [messages], one second at 1000 Hz."""
_QUEUE_BYTES = 64 * 2**20
"""Memory limit for the queue of a stream, in the publisher and in each subscriber [B]."""
_LONGEST_RECORD = 100_000
"""Queue depth for 100 s at 1000 messages per second [messages]. Unused entries take no memory."""
ACKNOWLEDGEMENT_LIMIT = 0.5
"""Longest wait for acknowledgements when a node ends [s]. It is sufficient on a busy machine."""
_POLL_INTERVAL = 0.02
"""Poll interval while waiting for subscribers [s]."""
_DISCOVERY_TIME = 1.0
"""Discovery counts as complete if the number of subscribers has not changed for this time [s]."""


def reliable_qos(depth: int) -> QoSProfile:
    """Return a reliable and volatile quality of service."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def stream_qos(message_size: int = 0) -> QoSProfile:
    """Return a reliable quality of service for a stream.

    The queue holds as many messages of `message_size` [B] as fit into 64 MiB, but at least 10 and
    at most 1000.
    """
    affordable = _QUEUE_BYTES // max(message_size, 1)
    return reliable_qos(int(min(_DEEPEST_QUEUE, max(10, affordable))))


def lossless_stream_qos() -> QoSProfile:
    """Return a reliable quality of service whose queue holds a recording of 100,000 messages."""
    return reliable_qos(_LONGEST_RECORD)


def command_qos() -> QoSProfile:
    """Return a volatile quality of service, so that late subscribers get no old commands."""
    return reliable_qos(100)


def latched_qos(depth: int = 1) -> QoSProfile:
    """Return a transient-local QoS: late subscribers receive the last `depth` messages."""
    latched = DurabilityPolicy.TRANSIENT_LOCAL
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=latched)


@dataclass(frozen=True)
class Topic:
    """Topic of the suite; its name is relative unless it begins with a slash."""

    name: str
    type: Any
    qos: QoSProfile

    @property
    def latched(self) -> bool:
        """Whether a late subscriber receives the last message."""
        return bool(self.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    def publisher(self, node: Node) -> Publisher:
        """Create a publisher of this topic for a node."""
        return node.create_publisher(self.type, self.name, self.qos)

    def subscribe(self, node: Node, take: Callable[[Any], None], raw: bool = False) -> None:
        """Subscribe a node to this topic; `take` gets each message, or its CDR bytes if `raw`."""
        node.create_subscription(self.type, self.name, take, self.qos, raw=raw)


_DISPLAY_QOS = reliable_qos(5)
"""Quality of service with a short queue, because displays need only the newest pictures."""

JOINT_STATES = Topic('joint_states', JointState, stream_qos())
NUDGE = Topic('nudge', Float64, command_qos())
EDGE_COMMAND = Topic('edge_command', msg.EdgeCommand, command_qos())
JOINT_COMMANDS = Topic('joint_commands', JointState, command_qos())
EFFORT_COMMANDS = Topic('edge_actuator/commands', Float64MultiArray, command_qos())
JOINT_TRAJECTORY = Topic('edge_actuator/joint_trajectory', JointTrajectory, command_qos())
LAST_KICK = Topic('last_kick', msg.LastKick, latched_qos())
DELIVERY = Topic('delivery', msg.Delivery, latched_qos(_DEEPEST_QUEUE))
ROTOR_IMPULSES = Topic('rotor_impulses', msg.RotorImpulses, command_qos())
DELIVERED_IMPULSES = Topic('delivered_impulses', msg.RotorImpulses, command_qos())
ROTOR_TORQUES = Topic('rotor_torques', JointState, command_qos())
TILT = Topic('tilt', Float64, command_qos())
SOLITON_STATE = Topic('soliton_state', msg.SolitonState, stream_qos())
SOLITON_EVENTS = Topic('soliton_events', msg.SolitonEvent, stream_qos())
CHAIN = Topic('chain', msg.Chain, latched_qos())
IDENTIFIED_CHAIN = Topic('identified_chain', msg.Chain, latched_qos())
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, command_qos())
CLOCK = Topic('/clock', Clock, stream_qos())
ROBOT_DESCRIPTION = Topic('robot_description', String, latched_qos())
MARKERS = Topic('markers', MarkerArray, _DISPLAY_QOS)
SOLITON_POSE = Topic('soliton_pose', PoseWithCovarianceStamped, _DISPLAY_QOS)
KYMOGRAPH = Topic('kymograph', Image, _DISPLAY_QOS)
JOINT_STATE_DEVIATIONS = Topic('joint_state_deviations', JointState, stream_qos())
IMAGE = Topic('image', Image, _DISPLAY_QOS)
COMPRESSED_IMAGE = Topic('image/compressed', CompressedImage, _DISPLAY_QOS)
CAMERA_INFO = Topic('camera_info', CameraInfo, _DISPLAY_QOS)
CAMERA_OVERLAY = Topic('camera_overlay', CompressedImage, _DISPLAY_QOS)
MOVE_SOLITON = 'move_soliton'

SUITE_TOPICS = (
    *(CHAIN, IDENTIFIED_CHAIN, JOINT_STATES, JOINT_STATE_DEVIATIONS, NUDGE, EDGE_COMMAND),
    *(JOINT_COMMANDS, EFFORT_COMMANDS, JOINT_TRAJECTORY, LAST_KICK, DELIVERY),
    *(DELIVERED_IMPULSES, ROTOR_IMPULSES, ROTOR_TORQUES, TILT, SOLITON_STATE, SOLITON_EVENTS),
    DIAGNOSTICS,
)
"""Topics that the nodes exchange. A recorder stores these topics by default."""
DISPLAY_TOPICS = (ROBOT_DESCRIPTION, MARKERS, SOLITON_POSE, KYMOGRAPH)
"""Topics for viewers. Nodes compute their contents from the messages of `SUITE_TOPICS`."""


def node_of(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of the node to which a publisher or subscription belongs."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def wait_for_acknowledgements(publisher: Publisher) -> None:
    """Wait up to 0.5 s until all subscribers have received the published messages."""
    publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGEMENT_LIMIT))


def wait_for_subscriber(
    publisher: Publisher, seconds: float, stopping: threading.Event | None = None, fewest: int = 1
) -> bool:
    """Wait for at least `fewest` subscribers, and then until their number is constant for 1 s.

    Returns False if `stopping` is set, or if there are fewer subscribers after `seconds`. The wait
    for a constant number has no time limit.
    """
    stopped = stopping or threading.Event()
    deadline = time.monotonic() + seconds
    met, met_at = 0, 0.0
    while met < fewest or time.monotonic() - met_at < _DISCOVERY_TIME:
        matched = publisher.get_subscription_count()
        if matched != met:
            met, met_at = matched, time.monotonic()
        elif met < fewest and time.monotonic() > deadline:
            return False
        if stopped.wait(_POLL_INTERVAL):
            return False
    return True
