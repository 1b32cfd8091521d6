# SPDX-License-Identifier: Apache-2.0
"""Latest joint states for an edge actuator, and the publishers of the actuator."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from soliton_linkage.actuation.kick_record import KickReport
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages import cdr
from soliton_linkage_nodes.messages.command_conversions import last_kick_to_msg
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain, frame_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import yield_core
from soliton_linkage_nodes.runtime.stamps import SECOND, Freshness, stamp_of


class LatestFrames:
    """Last two messages of joint states. A message is decoded only if it is needed."""

    def __init__(self, longest: float, watch: Callable[[int, Array], None]) -> None:
        """Create a store without frames.

        The latest frame cannot be read if it arrived more than `longest` [s] ago. When a frame is
        read for the first time, `watch` is called with its stamp [ns] and angles [rad].
        """
        self.freshness = Freshness(longest)
        self.taken = 0
        self._longest = longest
        self._watch = watch
        self._watched = 0
        self._decoder = cdr.JointStateDecoder()
        self._previous: bytes | None = None
        self._latest: bytes | None = None

    def take(self, serialized: bytes) -> None:
        """Store a serialized message of joint states."""
        self._previous, self._latest = self._latest, serialized
        self.taken += 1
        self.freshness.renew()

    def check_fresh(self) -> bytes:
        """Return the latest message; ValueError if it is too old or none has arrived."""
        if self._latest is None or self.freshness.stale:
            raise ValueError(
                f'no fresh joint_states: {self.freshness}, the limit is {self._longest:g} s; '
                'start or resume the simulator, or raise state_timeout'
            )
        return self._latest

    def read(self, named: NamedChain) -> tuple[Frame, int]:
        """Return the latest frame and its stamp [ns]; ValueError if it is too old or invalid."""
        joints = self._decoder.decode(self.check_fresh())
        frame = frame_from_msg(named, joints)
        if self._watched != self.taken:
            self._watched = self.taken
            self._watch(joints.stamp, frame.angles)
        return frame, joints.stamp

    @property
    def stamp_before(self) -> int | None:
        """Stamp of the frame before the latest one [ns], or None if there is no such frame."""
        return None if self._previous is None else stamp_of(self._previous)

    def period(self, stamp: int) -> float | None:
        """Return the time [s] from the frame before the latest one to `stamp` [ns].

        Returns None if there is no such frame, or if `stamp` is not later than this frame.
        """
        before = self.stamp_before
        return None if before is None or stamp <= before else (stamp - before) / SECOND


class ActuatorPublishers:
    """Publishers of `rotor_impulses`, `rotor_torques` and `last_kick`.

    The stamps of impulses and torques are the times of their publication.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._impulses = interfaces.ROTOR_IMPULSES.publisher(node)
        self._torques = interfaces.ROTOR_TORQUES.publisher(node)
        self._last_kick = interfaces.LAST_KICK.publisher(node)
        self._buffers: tuple[NamedChain, cdr.ImpulseBuffer, cdr.TorqueBuffer] | None = None

    @property
    def now(self) -> int:
        """Present time of the node's clock [ns]."""
        return int(self._node.get_clock().now().nanoseconds)

    @property
    def subscribers(self) -> int:
        """Number of subscribers of `rotor_impulses`."""
        return int(self._impulses.get_subscription_count())

    @property
    def connected(self) -> bool:
        """Whether `rotor_impulses` or `rotor_torques` has a subscriber."""
        return bool(self.subscribers or self._torques.get_subscription_count())

    @property
    def measured(self) -> bool:
        """Whether a node publishes `delivery`, which contains the measured effect of commands."""
        return bool(self._node.count_publishers(interfaces.DELIVERY.name))

    def check_connected(self, at_once: bool) -> None:
        """Raise ValueError if nothing subscribes to the topic of kicks (`at_once`) or torques."""
        publisher = self._impulses if at_once else self._torques
        if not publisher.get_subscription_count():
            name = publisher.topic_name.rsplit('/', 1)[-1]
            raise ValueError(f'nothing subscribes to {name}; start the simulator first')

    def kick(self, named: NamedChain, impulses: Array) -> None:
        """Publish the angular impulses on all rotors [N m s], shape (N,)."""
        buffer, _ = self._buffers_of(named)
        cdr.publish_buffer(self._impulses, buffer.fill(self.now, impulses))
        yield_core()

    def drive(self, named: NamedChain, torques: Array) -> None:
        """Publish the torques on all rotors [N m], shape (N,)."""
        _, buffer = self._buffers_of(named)
        cdr.publish_buffer(self._torques, buffer.fill(self.now, torques))

    def report(self, named: NamedChain, kick: KickReport) -> None:
        """Publish the report of a finished kick."""
        self._last_kick.publish(last_kick_to_msg(named, kick))

    def flush(self) -> None:
        """Wait at most 0.5 s until the subscribers have acknowledged the last torques."""
        interfaces.wait_for_acknowledgements(self._torques)

    def _buffers_of(self, named: NamedChain) -> tuple[cdr.ImpulseBuffer, cdr.TorqueBuffer]:
        if self._buffers is None or self._buffers[0] is not named:
            self._buffers = (named, cdr.ImpulseBuffer(named), cdr.TorqueBuffer(named))
        return self._buffers[1:]
