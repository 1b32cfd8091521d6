# SPDX-License-Identifier: Apache-2.0
"""A microcontroller in place of the simulator: angles of its encoders, torques to its valves."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.linkage.quantities import quantity
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
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, LogThrottle, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.runtime.subscriptions import CountedSubscription
from soliton_linkage_nodes.serial_encoders.port import ReopenedPort, ports_in_words, pyserial
from soliton_linkage_nodes.serial_encoders.valves import ValveParameters, Valves

_MOST_READINGS = 3
"""Readings of two clocks, repeated if other programs run in between [1]."""
_QUICK_READING = 20_000
"""Duration of a reading of two clocks that is exact enough [ns]: ten times the usual one."""
_WARNING_PERIOD = 1.0
"""Period of warnings about restarts of the controller [s]: a person reads no faster."""
_LONGEST_DELAY = 0.5
"""Delay of a frame without a warning [s]: beyond it the analyser skips frames, too."""


@dataclass(frozen=True)
class SerialEncodersParameters:
    """Serial port of the controller."""

    port: str = quantity(
        '', 'serial port of the controller, as /dev/ttyACM0 or a path in /dev/serial/by-id'
    )
    baud_rate: int = quantity(
        115_200, 'symbols a second of a UART; USB itself has none', 'baud', 300, 12_000_000
    )
    least_delay: float = quantity(
        0.0,
        'least time from a measurement to its arrival, which nothing at this end can tell: stamps '
        'are late by what it is more; on a UART ten bits a byte',
        's',
        0.0,
        1.0,
    )


class _LineCounts(NamedTuple):
    """What has arrived on the line."""

    bytes: int = 0
    frames: int = 0
    corrupted: int = 0
    lost: int = 0
    restarts: int = 0


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
        self._counted, self._reported_at = _LineCounts(), time.monotonic()
        self.diagnostics = Diagnostics(self, 'serial line', self.reporting(self._report))
        self._restarts = LogThrottle(self.get_logger().warning, _WARNING_PERIOD)
        self._take = self.diagnostics.guarded('frame', self._on_frame)
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
        take_torques = self.diagnostics.guarded('rotor_torques', self._on_torques)
        CountedSubscription(self, interfaces.ROTOR_TORQUES, take_torques, self.diagnostics)
        self.get_logger().info(f'hearing {self._source.description} on {self.settings.port}')

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
        self.decoder.reset()
        if self.stream is not None:
            self.stream.reset()

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
            self._restarts.log('the clock of the controller has begun anew')
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
        for _ in range(_MOST_READINGS):
            before = time.monotonic_ns()
            now = clock.now().nanoseconds
            after = time.monotonic_ns()
            brackets.append((after - before, now - (before + after) // 2))
            if after - before < _QUICK_READING:
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
        stamp, tolerance = time_from_msg(message.header.stamp), given.stamp_tolerance
        apart = abs(self.get_clock().now().nanoseconds - stamp) / SECOND
        if stamp and tolerance and apart > tolerance:
            raise ValueError(
                f'its stamp is {apart:.3g} s from now, the limit is {tolerance:g} s; stamp it '
                'with now or with 0, or raise valves.stamp_tolerance'
            )
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
        decoder, clock, port = self.decoder, self.stream.clock, self.settings.port
        lost = self.stream.lost
        now = _LineCounts(self._bytes, decoder.frames, decoder.corrupted, lost, clock.restarts)
        new = _LineCounts(*(a - b for a, b in zip(now, self._counted, strict=True)))
        begin, self._reported_at, self._counted = self._reported_at, time.monotonic(), now
        values: dict[str, Any] = {
            'rate [Hz]': new.frames / max(self._reported_at - begin, 1e-9),
            'frames': now.frames,
            'frames lost': now.lost,
            'frames corrupted': now.corrupted,
            'restarts of the controller': now.restarts,
            'commands to the valves': 0 if self.valves is None else self.valves.told,
            'drift of the controller [ppm]': 1e6 * clock.drift,
            'delay [s]': clock.delay,
        }
        if not math.isnan(clock.scatter):
            values['stamps sure to [s]'] = clock.scatter
        if not new.frames:
            silent = f'waiting for frames on {port}'
            noise = f'{new.bytes} bytes and no frame on {port}; check baud_rate and the protocol'
            return Report(noise if new.bytes else silent, values, warning=True)
        told = [f'{new.lost} frames were lost'] if new.lost else []
        if new.corrupted:
            told.append(f'{new.corrupted} frames were corrupted: {decoder.complaint}')
        if new.restarts:
            told.append(f'the clock of the controller has begun anew, {now.restarts} times in all')
        if clock.delay > _LONGEST_DELAY:
            told.append(
                f'frames are {clock.delay:.2g} s late, or the times of the controller are no '
                'microseconds'
            )
        protocol = decoder.protocol.value if decoder.protocol is not None else 'no'
        return Report(
            '; '.join(told) or f'hearing {protocol} frames on {port}', values, bool(told)
        )


def main() -> None:
    """Hear the controller until it is told to stop."""
    run(SerialEncoders)
