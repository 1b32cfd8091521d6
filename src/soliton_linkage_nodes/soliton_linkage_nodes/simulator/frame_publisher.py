# SPDX-License-Identifier: Apache-2.0
"""Publishers of a simulator for its frames, its chain and the effects of commands."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from soliton_linkage.actuation.kick_record import DeliveryTotals
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.encoders import EncoderErrors, Encoders
from soliton_linkage_nodes.messages.cdr import ImpulseBuffer, JointStateBuffer, publish_buffer
from soliton_linkage_nodes.messages.command_conversions import delivery_to_msg
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import yield_core
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg


class SensedJoints:
    """Serialized joint states with the errors of simulated encoders.

    Joints without an encoder are omitted. The angles include the errors of the encoders and the
    known encoder offsets. These are the offsets in the topic `chain`, which receivers subtract
    from the angles. The angular velocities include only the errors of the encoders. The torques
    are exact.
    """

    def __init__(
        self, named: NamedChain, period: float, errors: EncoderErrors, missing: Collection[int]
    ) -> None:
        """Create the message without the rotors `missing`; `period` is the frame interval [s]."""
        shown = [rotor for rotor in range(named.rotors) if rotor not in missing]
        names = tuple(named.joint_names[rotor] for rotor in shown)
        self._shown = np.array(shown, dtype=np.intp) if missing else None
        self._buffer = JointStateBuffer(NamedChain(named.chain, names))
        self._known_offsets = named.encoder_offsets
        self._encoders = Encoders(named.rotors, period, errors)
        self.change(errors)
        self._simulation: Simulation | None = None

    def __len__(self) -> int:
        """Return the size of the serialized message [B]."""
        return len(self._buffer)

    def change(self, errors: EncoderErrors) -> None:
        """Set the errors of the encoders from the next frame on."""
        if self._known_offsets:
            offsets = np.add(self._known_offsets, errors.offsets or 0.0)
            errors = replace(errors, offsets=tuple(offsets.tolist()))
        self._encoders.errors = errors

    def fill(self, stamp: int, frame: int, simulation: Simulation) -> bytearray:
        """Return the message for the current frame of a simulation, with a `stamp` [ns].

        The next call overwrites the message. The simulated encoders estimate the angular
        velocities only from frames since the last reset.
        """
        angles, rates = simulation.angles, simulation.rates
        if not self._encoders.errors.none:
            if simulation is not self._simulation:
                self._encoders.forget()
                self._simulation = simulation
            angles, rates = self._encoders.read(frame, angles)
        shown, torques = self._shown, simulation.link_torques
        if shown is not None:
            angles, rates, torques = angles[shown], rates[shown], torques[shown]
        return self._buffer.fill(stamp, angles, rates, torques)


class DeliveryPublisher:
    """Publisher of `delivery`: the total effect of all impulses and torques on the chain.

    The totals are the number and the work of the impulses, the work of the torques, and the
    angular impulse of the torques on each rotor. The totals of torques are exact, because torques
    are constant between two frames. A message is published at a frame if impulses or torques have
    acted since the previous frame. One more message, after the first frame interval without
    torques, reports that the torques have ended. A reset of the simulation does not change the
    totals.
    """

    def __init__(self, node: Node, number_of_rotors: int, stamp: int) -> None:
        """Create the publisher, and publish totals of zero with the stamp `stamp` [ns]."""
        self._publisher = interfaces.DELIVERY.publisher(node)
        self._delivered = DeliveryTotals(stamp, 0, 0.0, False, 0.0, np.zeros(number_of_rotors))
        self._simulation: Simulation | None = None
        self._angles = self._torques = np.zeros(number_of_rotors)
        self._kicks, self._kick_work = 0, 0.0
        self._counted = (0, 0.0)
        self._publisher.publish(delivery_to_msg(self._delivered))

    def add(self, stamp: int, simulation: Simulation) -> None:
        """Add the impulses and torques since the previous frame to the totals.

        `stamp` is the stamp of the current frame [ns]. Impulses that act at the current frame are
        added at the next frame.
        """
        if simulation is not self._simulation:
            self._simulation = simulation
            self._angles, self._torques = simulation.angles, 0 * self._torques
            self._counted = (0, 0.0)
        before = self._delivered
        acting = bool(self._torques.any())
        if acting or before.torques_act or self._kicks:
            turned = simulation.angles - self._angles
            kicks = before.impulses + self._kicks, before.work_of_impulses + self._kick_work
            work = before.work_of_torques + float(self._torques @ turned)
            impulse = before.impulse_of_torques + self._torques * simulation.period
            self._delivered = DeliveryTotals(stamp, *kicks, acting, work, impulse)
            self._publisher.publish(delivery_to_msg(self._delivered))
        self._angles, self._torques = simulation.angles, simulation.torques
        counted, counted_work = self._counted
        self._kicks = simulation.kicks - counted
        self._kick_work = simulation.kick_work - counted_work
        self._counted = (simulation.kicks, simulation.kick_work)


class FramePublisher:
    """Publisher of `joint_states`, `chain`, `delivery`, `delivered_impulses` and `/clock`."""

    def __init__(
        self, node: Node, named: NamedChain, joints: SensedJoints, rate: float, clock: bool
    ) -> None:
        """Create the publishers. `rate` is the frame rate in simulated time [Hz].

        `/clock` is published only if `clock` is set.
        """
        self.epoch: int | None = None
        """Stamp of the first frame [ns], or None before the first call of `begin`."""
        self.stamp = 0
        """Stamp of the last frame [ns]."""
        self._node = node
        self._named = named
        self._joints = joints
        self._rate = rate
        deep = interfaces.stream_qos(len(joints))
        self._joint_states = replace(interfaces.JOINT_STATES, qos=deep).publisher(node)
        self._clock = interfaces.CLOCK.publisher(node) if clock else None
        self._chain = interfaces.CHAIN.publisher(node)
        self._impulses = interfaces.DELIVERED_IMPULSES.publisher(node)
        self._impulse_buffer = ImpulseBuffer(named)

    @property
    def subscribers(self) -> int:
        """Number of subscribers of `joint_states`."""
        return int(self._joint_states.get_subscription_count())

    @property
    def depth(self) -> int:
        """Queue depth of `joint_states` [frames]."""
        return int(self._joint_states.qos_profile.depth)

    def begin(self) -> None:
        """Publish the chain, and use the current time as the stamp of the first frame.

        All calls except the first have no effect.
        """
        if self.epoch is not None:
            return
        self.epoch = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self.publish_chain(self._named)
        self._delivery = DeliveryPublisher(self._node, self._named.rotors, self.epoch)

    def publish_chain(self, named: NamedChain) -> None:
        """Publish a chain whose parameters apply from the next frame on."""
        self._named = named
        if self.epoch is not None:
            stamp = max(self.epoch, self.stamp)
            self._chain.publish(chain_to_msg(named, time_to_msg(stamp)))

    def flush(self) -> None:
        """Wait at most 0.5 s until the subscribers have acknowledged the last frames."""
        interfaces.wait_for_acknowledgements(self._joint_states)

    def announce(self, frame: int, impulses: Array) -> None:
        """Publish the impulses [N m s], shape (N,), that act at frame number `frame`."""
        buffer = self._impulse_buffer.fill(self._stamp_of(frame), impulses)
        publish_buffer(self._impulses, buffer)

    def publish(self, frame: int, simulation: Simulation) -> None:
        """Publish the current frame of a simulation. Its number is `frame`."""
        stamp = self.stamp = self._stamp_of(frame)
        if self._clock is not None:
            self._clock.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
        publish_buffer(self._joint_states, self._joints.fill(stamp, frame, simulation))
        yield_core()
        self._delivery.add(stamp, simulation)

    def _stamp_of(self, frame: int) -> int:
        return (self.epoch or 0) + round(frame * SECOND / self._rate)
