# SPDX-License-Identifier: Apache-2.0
"""A microcontroller in place of the simulator: angles of its encoders, torques to its valves."""

from __future__ import annotations

import time
from typing import Any, ClassVar

from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.microcontroller.frames import FrameDecoder, SerialFrame, encode
from soliton_linkage.microcontroller.rotary_encoders import (
    AngleReader,
    AngleStream,
    RotaryEncoders,
)
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    ChainSource,
    ChainSourceParameters,
)
from soliton_linkage_nodes.messages.conversions import (
    FRAME,
    NamedChain,
    chain_to_msg,
    impulses_to_msg,
    torques_from_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.intake.complaints import Complaints
from soliton_linkage_nodes.runtime.intake.counted import CountedSubscription
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.serial_encoders.line_report import LineAccount, line_in_words
from soliton_linkage_nodes.serial_encoders.parameters import (
    SerialEncodersParameters,
    ValveParameters,
)
from soliton_linkage_nodes.serial_encoders.port import ReopenedPort, ports_in_words, pyserial
from soliton_linkage_nodes.serial_encoders.valves import Valves

_MOST_LOOKS = 3
"""At two clocks, where other programs come in between [1]."""
_SAID_AGAIN = 1.0
"""After which another restart of the controller is said [s]: a person reads no faster."""
_QUICK_LOOK = 20_000
"""At two clocks [ns], which is as sure as they need to be; it takes a tenth of that."""


class SerialEncoders(ManagedNode):
    """Publishes the angles that a microcontroller measures, and tells its valves what to do.

    Publishes `joint_states` [rad], NaN for rotors that are missing, with the stamp of their
    measurement, before that what the valves have delivered until then as `delivered_impulses`
    [N m s], `/diagnostics` and, where it is told the chain by parameters, `chain` (latched).
    Subscribes to `rotor_torques` [N m] and, unless told the chain by parameters, to `chain`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        SerialEncodersParameters: '',
        RotaryEncoders: 'encoders.',
        ValveParameters: 'valves.',
        ManagedParameters: '',
        ChainSourceParameters: '',
        **CHAIN_PARAMETERS,
    }

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('serial_encoders', **kwargs)

    def configure(self) -> None:
        """Learn the chain, and open the topics."""
        pyserial()
        self.settings = current(self, SerialEncodersParameters)
        if not self.settings.port:
            raise ValueError(f'parameter port is empty; set it: {ports_in_words()}')
        self.decoder = FrameDecoder()
        self.stream: AngleStream | None = None
        self.valves: Valves | None = None
        self._named: NamedChain | None = None
        self._port: ReopenedPort | None = None
        self._bytes, self._stamp = 0, 0
        self._reported = LineAccount(seconds=time.monotonic())
        self.diagnostics = Diagnostics(self, 'serial line', self.reporting(self._report))
        self._restarts = Complaints(self.get_logger().warning, _SAID_AGAIN)
        self._take = self.diagnostics.refusing('frame', self._on_frame)
        self._angles = interfaces.JOINT_STATES.publisher(self)
        self._impulses = interfaces.DELIVERED_IMPULSES.publisher(self)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        if self._source.parameters.chain_from == 'parameters' and self._named is not None:
            stamp = self.get_clock().now().to_msg()
            interfaces.CHAIN.publisher(self).publish(chain_to_msg(self._named, stamp))
        rate = current(self, ValveParameters, 'valves.').command_rate
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._commanding = self.create_timer(1 / rate, self._command, clock=steady)
        self._commanding.cancel()
        take_torques = self.diagnostics.refusing('rotor_torques', self._on_torques)
        CountedSubscription(self, interfaces.ROTOR_TORQUES, take_torques, self.diagnostics)
        self.get_logger().info(f'hearing {self._source.in_words} on {self.settings.port}')

    def activate(self) -> None:
        """Open the port, and begin to hear the controller."""
        self._begin_anew()
        self._port = ReopenedPort(
            self.settings.port, self.settings.baud_rate, self._hear, self._on_port, self.real_time
        )

    def deactivate(self) -> None:
        """Shut the valves, and let the port go."""
        self._commanding.cancel()
        if self.valves is not None and not self.valves.shut:
            self.valves.release()
            self._tell_valves()
        if self._port is not None:
            self._port.close()
            self._port = None

    def _on_chain(self, named: NamedChain) -> None:
        if named == self._named:
            return
        reader = AngleReader(current(self, RotaryEncoders, 'encoders.'), named.rotors)
        valves = Valves(current(self, ValveParameters, 'valves.'), named.rotors)
        self._named, self.stream, self.valves = named, AngleStream(reader), valves

    def _begin_anew(self) -> None:
        self.decoder.begin_anew()
        if self.stream is not None:
            self.stream.begin_anew()

    def _on_port(self, reason: str) -> None:
        """Tell that the port is gone, or is back: called by the thread that reads it."""
        if reason:
            self.get_logger().warning(f'{self.settings.port} is gone: {reason}; waiting for it')
        else:
            self._begin_anew()
            self.get_logger().info(f'{self.settings.port} is back')

    def _hear(self, chunk: bytes, arrival: int) -> None:
        """Publish what the controller says: called by the thread that reads the port."""
        self._bytes += len(chunk)
        for frame in self.decoder.feed(chunk):
            self._take(frame, arrival)

    def _on_frame(self, frame: SerialFrame, arrival: int) -> None:
        if self.stream is None or self.valves is None or self._named is None:
            return
        restarts = self.stream.clock.restarts
        read = self.stream.take(frame, arrival)
        if self.stream.clock.restarts != restarts:
            self._restarts.tell('the clock of the controller has begun anew')
        if read is None:
            return
        measured = read.stamp - round(self.settings.least_delay * SECOND)
        self._stamp = max(measured + self._clock_ahead(), self._stamp + 1)
        stamp = time_to_msg(self._stamp)
        impulses = self.valves.delivered(measured / SECOND)
        if impulses.any():
            self._impulses.publish(impulses_to_msg(self._named, impulses, stamp))
        header = Header(stamp=stamp, frame_id=FRAME)
        names = list(self._named.joint_names)
        message = JointState(header=header, name=names, position=read.angles.tolist())
        self._angles.publish(message)

    def _clock_ahead(self) -> int:
        """By what the clock of the node is ahead of the monotonic one [ns]."""
        clock, brackets = self.get_clock(), []
        for _ in range(_MOST_LOOKS):
            before = time.monotonic_ns()
            now = clock.now().nanoseconds
            after = time.monotonic_ns()
            brackets.append((after - before, now - (before + after) // 2))
            if after - before < _QUICK_LOOK:
                break
        return min(brackets)[1]

    def _on_torques(self, message: JointState) -> None:
        self.check_active()
        if self._named is None or self.valves is None:
            raise ValueError('the chain is not known yet; publish the topic chain')
        if self._port is None or not self._port.open:
            raise ValueError(f'{self.settings.port} is gone; plug the controller in')
        if self.decoder.protocol is None:
            raise ValueError(f'the controller on {self.settings.port} has not been heard yet')
        given = current(self, ValveParameters, 'valves.')
        check_of_now(self, message, given.stamp_tolerance)
        torques = torques_from_msg(self._named.numbers, message, given.torque_limit)
        if self.valves.shut and not torques.any():
            return
        self.valves.hold(torques, time.monotonic())
        if self._commanding.is_canceled():
            self._commanding.reset()
            self._tell_valves()

    def _command(self) -> None:
        """Renew what the valves are told, until they are shut."""
        self._tell_valves()
        if self.valves is None or self.valves.shut:
            self._commanding.cancel()

    def _tell_valves(self) -> None:
        if self.valves is None or self._port is None or self.decoder.protocol is None:
            return
        now = time.monotonic()
        command = self.valves.command(now)
        try:
            self._port.write(encode(command, self.decoder.protocol))
            if self._port.open:
                self.valves.note_told(now)
        except OSError as error:
            self.diagnostics.fail(f'could not tell the valves: {error}')

    def _report(self) -> Report:
        if self.stream is None or self._port is None:
            return Report('waiting for the topic chain', warning=True)
        before, now = self._reported, LineAccount.now(self._bytes, self.decoder, self.stream)
        self._reported = now
        told = 0 if self.valves is None else self.valves.told
        return line_in_words(now, before, self.settings.port, self.decoder, self.stream, told)


def check_of_now(node: ManagedNode, message: JointState, tolerance: float) -> None:
    """Raise ValueError for torques whose stamp is another time [s] than now."""
    stamp = time_from_msg(message.header.stamp)
    apart = abs(node.get_clock().now().nanoseconds - stamp) / SECOND
    if stamp and tolerance and apart > tolerance:
        raise ValueError(
            f'its stamp is {apart:.3g} s from now, the limit is {tolerance:g} s; stamp it with '
            'now or with 0, or raise valves.stamp_tolerance'
        )


def main() -> None:
    """Hear the controller until it is told to stop."""
    run(SerialEncoders)
