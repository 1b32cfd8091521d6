# SPDX-License-Identifier: Apache-2.0
"""Node that reads encoders and drives valves through a microcontroller on a serial port."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Any, ClassVar

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.dynamics.motor_controllers import MotorControllers
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.microcontroller.frames import FrameDecoder, SerialFrame, encode
from soliton_linkage.microcontroller.rotary_encoders import (
    AngleReader,
    AngleStream,
    RotaryEncoders,
)
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS, ChainSource
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, LogThrottle, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.runtime.subscriptions import CountedSubscription
from soliton_linkage_nodes.serial_encoders.port import ReopenedPort, describe_ports, pyserial
from soliton_linkage_nodes.serial_encoders.valves import ValveParameters, Valves

_CLOCK_READINGS = 3
"""Largest number of attempts to read two clocks without an interruption [1]."""
_CLOCK_READING_LIMIT = 20_000
"""Duration above which a reading of two clocks counts as interrupted [ns]. A reading usually takes
a tenth of this time."""
_WARNING_PERIOD = 1.0
"""Shortest time between two warnings about restarts or jumps of the controller's clock [s]."""
_LONGEST_DELAY = 0.5
"""Largest `DeviceClock.delay` without a warning [s]. This is the time from the measurement of the
last frame to its arrival, minus the fitted smallest time from a measurement to its arrival."""


@dataclass(frozen=True)
class SerialEncodersParameters:
    """Parameters of the serial port of the controller."""

    port: str = quantity(
        '', 'serial port of the controller, such as /dev/ttyACM0 or a path in /dev/serial/by-id'
    )
    baud_rate: int = quantity(
        115_200, 'baud rate of a UART; a USB device ignores it', 'baud', 300, 12_000_000
    )
    hang_up: bool = quantity(
        True,
        'whether DTR is released when the port closes; with false, only the first opening after '
        'the board was plugged in resets an Arduino Uno',
    )
    least_delay: float = quantity(
        0.0,
        'shortest time from a measurement to its arrival, which the node cannot measure and '
        'subtracts from the stamps; a UART needs ten bit times per byte',
        's',
        0.0,
        1.0,
    )


class SerialEncoders(ManagedNode):
    """Node that publishes angles from a microcontroller and commands the torques of its valves.

    The node publishes the angles in `joint_states` [rad] with the time of the measurement as
    stamp. The angles of missing rotors are NaN. The node subscribes to `rotor_torques` [N m]. If
    the chain has feedback, the node computes feedback torques from the measured angles and adds
    them to these torques. Before each frame the node publishes `delivered_impulses` [N m s],
    unless all of them are 0. They are the impulses of `rotor_torques`, without the feedback, from
    the measurement of the previous frame to the measurement of this frame. The node also publishes
    `/diagnostics` and, if parameters describe the chain, `chain`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        SerialEncodersParameters: '',
        RotaryEncoders: 'encoders.',
        ValveParameters: 'valves.',
        ManagedParameters: '',
        **CHAIN_SOURCE_PARAMETERS,
    }

    def configure(self) -> None:
        """Read the parameters, and create publishers and subscriptions."""
        pyserial()
        self.settings = self.current(SerialEncodersParameters)
        if not self.settings.port:
            raise ValueError(f'parameter port is empty; set it: {describe_ports()}')
        self.decoder = FrameDecoder()
        self.stream: AngleStream | None = None
        self.valves: Valves | None = None
        self._motors: MotorControllers | None = None
        self._sending = threading.Lock()
        self._named: conversions.NamedChain | None = None
        self._port: ReopenedPort | None = None
        self._bytes, self._stamp = 0, 0
        self._increments = Increments()
        self.diagnostics = Diagnostics(self, 'serial line', self.reporting(self._report))
        self._restarts = LogThrottle(self.get_logger().warning, _WARNING_PERIOD)
        self._take = self.diagnostics.guarded('frame', self._on_frame)
        self._angles = interfaces.JOINT_STATES.publisher(self)
        self._impulses = interfaces.DELIVERED_IMPULSES.publisher(self)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        self._source.publish_parameters()
        rate = self.current(ValveParameters).command_rate
        self._command_timer = self.create_timer(1 / rate, self._repeat_command)
        self._command_timer.cancel()
        take_torques = self.diagnostics.guarded('rotor_torques', self._on_torques)
        CountedSubscription(self, interfaces.ROTOR_TORQUES, take_torques, self.diagnostics)
        self.get_logger().info(f'reading {self._source.description} on {self.settings.port}')

    def activate(self) -> None:
        """Open the port, and start the thread that reads it."""
        self.decoder.reset()
        if self.stream is not None:
            self.stream.reset()
        port, baud_rate = self.settings.port, self.settings.baud_rate
        self._port = ReopenedPort(
            port,
            baud_rate,
            self._read,
            self._on_port,
            hang_up=self.settings.hang_up,
            real_time=self.real_time,
        )
        standard = pyserial().Serial.BAUDRATES
        if baud_rate not in standard:
            nearest = min(standard, key=lambda rate: abs(rate - baud_rate))
            self.get_logger().warning(
                f'baud_rate = {baud_rate} is not a standard rate; some systems accept it and use '
                f'another one; if no frames arrive, use {nearest} on both sides'
            )

    def deactivate(self) -> None:
        """Close the valves first, and then the port."""
        self._command_timer.cancel()
        if self.valves is not None and not self.valves.closed:
            self.valves.release()
            self._send_command()
        if self._port is not None:
            self._port.close()
            self._port = None

    def _on_chain(self, named: conversions.NamedChain) -> None:
        if named == self._named:
            return
        reader = AngleReader(self.current(RotaryEncoders), named.rotors)
        given, feedback = self.current(ValveParameters), named.chain.feedback
        if feedback.acts and feedback.limit > given.torque_limit:
            raise ValueError(
                f'feedback.limit = {feedback.limit:g} N m of the chain exceeds '
                f'valves.torque_limit = {given.torque_limit:g} N m; lower the first or raise the '
                'second'
            )
        valves = Valves(given, named.rotors)
        self._motors = MotorControllers(named.chain) if feedback.acts else None
        self._named, self.stream, self.valves = named, AngleStream(reader), valves

    def _on_port(self, reason: str) -> None:
        if reason:
            self.get_logger().warning(
                f'{self.settings.port} was lost: {reason}; plug the controller in'
            )
        else:
            self.decoder.reset()
            if self.stream is not None:
                self.stream.reconnect()
            self.get_logger().info(f'{self.settings.port} is open again')

    def _read(self, chunk: bytes, arrival: int) -> None:
        self._bytes += len(chunk)
        for frame in self.decoder.feed(chunk):
            self._take(frame, arrival)

    def _on_frame(self, frame: SerialFrame, arrival: int) -> None:
        if self.stream is None or self.valves is None or self._named is None:
            return
        clock = self.stream.clock
        restarts, jumps = clock.restarts, clock.jumps
        read = self.stream.take(frame, arrival)
        if clock.restarts != restarts:
            self._restarts.log('the clock of the controller restarted')
        if clock.jumps != jumps:
            self._restarts.log('the clock of the controller jumped')
        if read is None:
            return
        measured = read.stamp - round(self.settings.least_delay * SECOND)
        self._stamp = max(measured + self._clock_offset(), self._stamp + 1)
        stamp = time_to_msg(self._stamp)
        if (clock.restarts, clock.jumps) != (restarts, jumps) and self._motors is not None:
            self._motors = MotorControllers(self._named.chain)
        if self._motors is not None and self.active:
            torques = self._motors.torques(self._stamp / SECOND, read.angles)
            self.valves.feed_back(torques, time.monotonic())
            self._send_command()
        impulses = self.valves.delivered(measured / SECOND)
        if impulses.any():
            self._impulses.publish(conversions.impulses_to_msg(self._named, impulses, stamp))
        header = Header(stamp=stamp, frame_id=conversions.FRAME)
        names = list(self._named.joint_names)
        self._angles.publish(JointState(header=header, name=names, position=read.angles.tolist()))

    def _clock_offset(self) -> int:
        """Return the time of the ROS clock minus the time of the monotonic clock [ns]."""
        clock, readings = self.get_clock(), []
        for _ in range(_CLOCK_READINGS):
            before = time.monotonic_ns()
            now = clock.now().nanoseconds
            after = time.monotonic_ns()
            readings.append((after - before, now - (before + after) // 2))
            if after - before < _CLOCK_READING_LIMIT:
                break
        return min(readings)[1]

    def _on_torques(self, message: JointState) -> None:
        self.check_active()
        port = self.settings.port
        if self._named is None or self.valves is None:
            raise ValueError('the chain is unknown; publish the topic chain')
        if self._port is None or not self._port.is_open:
            raise ValueError(f'{port} is not open; plug the controller in')
        if self.decoder.protocol is None:
            raise ValueError(f'no frame was received from the controller on {port} yet')
        given = self.current(ValveParameters)
        stamp, tolerance = time_from_msg(message.header.stamp), given.stamp_tolerance
        difference = abs(self.get_clock().now().nanoseconds - stamp) / SECOND
        if stamp and tolerance and difference > tolerance:
            raise ValueError(
                f'its stamp differs from the clock by {difference:.3g} s, the limit is '
                f'{tolerance:g} s; stamp it with the present time or with 0, or raise '
                'valves.stamp_tolerance'
            )
        torques = conversions.torques_from_msg(self._named.numbers, message, given.torque_limit)
        if self.valves.closed and not torques.any():
            return
        self.valves.hold(torques, time.monotonic())
        if self._command_timer.is_canceled():
            self._command_timer.reset()
            self._send_command()

    def _repeat_command(self) -> None:
        self._send_command()
        if self.valves is None or self.valves.closed:
            self._command_timer.cancel()

    def _send_command(self) -> None:
        with self._sending:
            if self.valves is None or self._port is None or self.decoder.protocol is None:
                return
            now = time.monotonic()
            command = self.valves.command(now)
            try:
                self._port.write(encode(command, self.decoder.protocol))
                if self._port.is_open:
                    self.valves.record_sent(now)
            except OSError as error:
                self.diagnostics.fail(f'could not send a command to the valves: {error}')

    def _report(self) -> Report:
        if self.stream is None or self.valves is None:
            return Report('waiting for the topic chain', warning=True)
        decoder, clock, port = self.decoder, self.stream.clock, self.settings.port
        counts = decoder.frames, decoder.corrupted, self.stream.lost, clock.restarts, clock.jumps
        increments = self._increments.take(self._bytes, *counts)
        seconds, chunk, frames, corrupted, lost, restarts, jumps = increments
        values: dict[str, Any] = {
            'rate [Hz]': frames / max(seconds, 1e-9),
            'frames': decoder.frames,
            'frames lost': self.stream.lost,
            'frames corrupted': decoder.corrupted,
            'restarts of the controller': clock.restarts,
            'jumps of the clock of the controller': clock.jumps,
            'commands to the valves': self.valves.commands,
            'drift of the controller [ppm]': 1e6 * clock.drift,
            'delay [s]': clock.delay,
        }
        if not math.isnan(clock.scatter):
            values['uncertainty of stamps [s]'] = clock.scatter
        if not frames:
            silent = f'waiting for frames on {port}'
            noise = f'{chunk} bytes without a frame on {port}; check baud_rate and protocol'
            return Report(noise if chunk else silent, values, warning=True)
        warnings = [f'{lost} frames were lost'] if lost > 0 else []
        if corrupted:
            warnings.append(f'{corrupted} frames were corrupted: {decoder.complaint}')
        if restarts:
            warnings.append(
                f'the clock of the controller restarted, {clock.restarts} times in all'
            )
        if jumps:
            warnings.append(f'the clock of the controller jumped, {clock.jumps} times in all')
        if clock.delay > _LONGEST_DELAY:
            warnings.append(
                f'frames are {clock.delay:.2g} s late; check the load of the machine, and that '
                'the controller sends its time in microseconds'
            )
        protocol = decoder.protocol.value if decoder.protocol is not None else 'no'
        message = '; '.join(warnings) or f'receiving {protocol} frames on {port}'
        return Report(message, values, bool(warnings))
