# SPDX-License-Identifier: Apache-2.0
"""Node that estimates each rotor length, pivot distance and spring rest length of a chain."""

from __future__ import annotations

import dataclasses
import functools
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.result import Identification
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.chain_identifier.parameter_file import write_parameters
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.frames import EncoderMonitor, SerializedFrames
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription

_POLL_PERIOD = 0.1
"""Interval between two checks whether an identification has ended [s]."""


@dataclass(frozen=True)
class ChainIdentifierParameters:
    """Parameters of the chain identifier."""

    interval: float = quantity(
        10.0,
        'time between two identifications; 0 to identify only when ~/identify is called',
        's',
        0.0,
        3600.0,
    )
    most_frames: int = quantity(
        4000,
        'largest number of frames that are kept; beyond it the least informative frames are '
        'dropped. Sensitivity: at 0.5x, an identification takes half the time, and its standard '
        'deviations are 1.4 times as large',
        '',
        100,
        100_000,
    )
    tolerance: float = quantity(
        0.0,
        'relative standard deviation of the lengths of one kind; 0 to estimate it',
        '',
        0.0,
        1.0,
    )
    output: str = quantity('chain.yaml', 'path of the parameter file that ~/save writes')
    spacing: float = quantity(
        0.1, 'mean distance of neighbouring pivots, which angles do not determine', 'm', 1e-6, 1e3
    )
    mass: float = quantity(
        0.02, 'mean mass of the rotors, which angles do not determine', 'kg', 1e-9, 1e6
    )
    gravity: float = quantity(0.0, 'gravity in the plane of the chain', 'm/s^2', 0.0, 1e6)
    joint_names: tuple[str, ...] = quantity(
        (), 'names of the joints, rotor 0 first; empty to use the names in the first joint_states'
    )


class ChainIdentifier(ManagedNode):
    """Node that estimates each rotor length, pivot distance and spring rest length of a chain.

    It subscribes to `joint_states`, `joint_state_deviations` and `tilt`, and to
    `delivered_impulses` and `delivery`, which report the impulses on the chain. If no impulses are
    reported, the node uses the commands on `rotor_impulses` and `rotor_torques`. It publishes
    `identified_chain` and `/diagnostics`. `~/identify` starts an identification, `~/save` writes
    the last result to the file `output`, and `~/forget` discards all frames.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {ChainIdentifierParameters: '', ManagedParameters: ''}

    def configure(self) -> None:
        """Create the publisher, the subscriptions, the services and the timers."""
        settings = self.settings = self.current(ChainIdentifierParameters)
        conversions.check_names('parameter joint_names', settings.joint_names)
        self.found: Identification | None = None
        self._failure = ''
        self._record = self._new_record()
        self._identified_frames, self._progress, self._begun = 0, 0.0, 0.0
        self._working: threading.Thread | None = None
        self._outcome: Identification | ValueError | None = None
        self._decoder = JointStateDecoder()
        self._encoders = EncoderMonitor(self.get_logger().warning)
        self.diagnostics = Diagnostics(self, 'identification', self.reporting(self._report))
        self._publisher = interfaces.IDENTIFIED_CHAIN.publisher(self)
        take = self.diagnostics.guarded('joint_states', self.while_active(self._on_joint_states))
        StreamSubscription(
            self,
            interfaces.JOINT_STATES,
            take,
            self.diagnostics,
            raw=True,
            longest_lag=0.0,
            parts=SerializedFrames().parts,
        )
        deviations = self.diagnostics.guarded('joint_state_deviations', self._on_deviations)
        for topic, take in (
            (interfaces.JOINT_STATE_DEVIATIONS, deviations),
            (interfaces.TILT, self._on_tilt),
            (interfaces.DELIVERED_IMPULSES, lambda m: self._record.add_delivered_impulses(m)),
            (interfaces.DELIVERY, lambda m: self._record.add_delivery(m)),
            (interfaces.ROTOR_IMPULSES, self._on_command),
            (interfaces.ROTOR_TORQUES, self._on_command),
        ):
            topic.subscribe(self, self.while_active(take))
        self.create_service(Trigger, '~/identify', self._on_identify)
        self.create_service(Trigger, '~/save', self._on_save)
        self.create_service(Trigger, '~/forget', self._on_forget)
        self.create_timer(_POLL_PERIOD, self._publish_result)
        if settings.interval:
            self.create_timer(settings.interval, self._start_identification)
        frames = self.resolve_topic_name(interfaces.JOINT_STATES.name)
        self.get_logger().info(f'recording {frames} to identify its chain')

    @property
    def frames(self) -> int:
        """Number of frames received since the activation or the last call of `~/forget`."""
        return self._record.frames

    def _new_record(self) -> JointRecord:
        return JointRecord(self.settings.joint_names, self.settings.most_frames)

    def _on_joint_states(self, serialized: bytes) -> None:
        joints = self._decoder.decode(serialized)
        self._record.add(joints)
        self._encoders.check(joints.stamp, joints.position)

    def _on_deviations(self, message: JointState) -> None:
        self._record.add_deviations(conversions.joint_states_from_msg(message))

    def _on_command(self, message: RotorImpulses | JointState) -> None:
        self._record.add_command(message, self.get_clock().now().nanoseconds)

    def _on_tilt(self, message: Float64) -> None:
        if math.isfinite(message.data):
            self._record.add_tilt(message.data, self.get_clock().now().nanoseconds)

    def _start_identification(self) -> None:
        record = self._record
        idle = self.active and not self._working and record.frames
        if not idle or record.frames == self._identified_frames:
            return
        self._identified_frames, self._progress = record.frames, 0.0
        self._begun = time.monotonic()
        given = dataclasses.replace(
            Chain(), spacing=self.settings.spacing, mass=self.settings.mass
        )
        gravity = Gravity(self.settings.gravity)
        work = functools.partial(
            identify,
            record.readings(gravity),
            given,
            self.settings.tolerance or None,
            progress=self._show_progress,
        )
        self._working = threading.Thread(target=self._identify, args=(work,), daemon=True)
        self._working.start()

    def _identify(self, work: Callable[[], Identification]) -> None:
        try:
            self._outcome = work()
        except ValueError as error:
            self._outcome = error

    def _show_progress(self, done: float) -> None:
        self._progress = done

    def _publish_result(self) -> None:
        if self._working is None or self._working.is_alive():
            return
        outcome, self._working, self._outcome = self._outcome, None, None
        if not isinstance(outcome, Identification):
            self._failure = str(outcome)
            self.get_logger().error(f'no chain was identified: {outcome}')
            return
        if not self.frames:
            return
        self.found, self._failure = outcome, ''
        offsets = tuple(outcome.offsets.tolist())
        named = conversions.NamedChain(outcome.chain, self._record.joint_names, offsets)
        self._publisher.publish(conversions.chain_to_msg(named, self.get_clock().now().to_msg()))
        self.get_logger().info(f'identified {_summary(outcome)}')
        for warning in outcome.warnings:
            self.get_logger().warning(warning)

    def _on_identify(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._identified_frames = -1
        self._start_identification()
        response.success = self._working is not None
        response.message = (
            f'identifying the chain from {self.frames} frames; the result is published on '
            'identified_chain'
            if response.success
            else 'no joint_states were received yet; start the node that publishes them'
        )
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.found is None:
            response.message = self._failure or 'no chain is identified yet; call ~/identify'
            return response
        path = Path(self.settings.output)
        try:
            write_parameters(self.found, self._record.joint_names, self.get_name(), path)
        except OSError as error:
            response.message = f'{path} cannot be written: {error.strerror}; set output'
            return response
        response.success, response.message = True, f'wrote {path}'
        return response

    def _on_forget(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._record = self._new_record()
        self.found, self._failure = None, ''
        response.success, response.message = True, 'dropped all frames'
        return response

    def _report(self) -> Report:
        values: dict[str, Any] = {
            'frames': self.frames,
            'frames dropped': self.frames - len(self._record),
            'identifying': self._working is not None,
            'progress': f'{self._progress:.0%}',
        }
        if self._working is not None:
            values['identifying for [s]'] = time.monotonic() - self._begun
        if self.found is None:
            message = self._failure or 'no chain is identified yet'
            return Report(message, values, bool(self._failure))
        found = self.found
        values |= {
            'noise [rad]': found.noise,
            'noise from frame to frame [rad]': found.reading_noise,
            'tolerance': found.tolerance,
            'worst bonds': ', '.join(map(str, found.worst_bonds[:3])),
        }
        return Report('; '.join([_summary(found), *found.warnings]), values, bool(found.warnings))


def _summary(found: Identification) -> str:
    return f'a {found.chain.motion.value} of {found.chain.number_of_rotors} rotors'
