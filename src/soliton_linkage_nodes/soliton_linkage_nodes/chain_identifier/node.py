# SPDX-License-Identifier: Apache-2.0
"""The chain identifier: proposes the chain that joints are of, once a soliton has passed."""

from __future__ import annotations

import dataclasses
import math
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from soliton_linkage.identification.identification import Identification
from soliton_linkage.identification.identify import identify
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.chain_identifier.parameter_file import write_parameters
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    check_names,
    joint_states_from_msg,
)
from soliton_linkage_nodes.messages.frame_reader import EncoderMonitor
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription

_LOOK_PERIOD = 0.1
"""Between two looks whether a chain was found [s]: a person sees no wait."""


@dataclass(frozen=True)
class ChainIdentifierParameters:
    """Parameters of the chain identifier."""

    interval: float = quantity(
        10.0,
        'time between two tries to identify the chain by all frames so far, 0 for none but those '
        'that are asked for',
        's',
        0.0,
        3600.0,
    )
    most_frames: int = quantity(
        4000,
        'number of frames that are kept, beyond which those that tell least are left out; half '
        'of it makes lengths 1.4 times as unsure in half of the time',
        '',
        100,
        100_000,
    )
    tolerance: float = quantity(
        0.0,
        'standard deviation by which lengths of one kind differ from each other, 0 to have it '
        'learnt from the angles',
        '',
        0.0,
        1.0,
    )
    output: str = quantity('chain.yaml', 'path of the parameter file that ~/save writes')
    spacing: float = quantity(
        0.1, 'mean distance of neighbouring pivots, which angles do not tell', 'm', 1e-6, 1e3
    )
    mass: float = quantity(
        0.02, 'mean mass of the rotors, which angles do not tell', 'kg', 1e-9, 1e6
    )
    gravity: float = quantity(
        0.0, 'acceleration of a free mass in the plane of the chain', 'm/s^2', 0.0, 1e6
    )
    joint_names: tuple[str, ...] = quantity(
        (), 'names of the joints, rotor 0 first; empty for those of the first joint_states'
    )


class ChainIdentifier(ManagedNode):
    """Proposes the chain that joints are of, with every length of its own.

    Subscribes to `joint_states` [rad], to `joint_state_deviations`, by which they are weighed, and
    to `delivered_impulses`, `delivery` and `tilt`, between which a chain moves by itself, or to
    `rotor_impulses` and `rotor_torques` where nobody tells what was delivered.
    Publishes `identified_chain` and `/diagnostics`. Serves `~/identify`, which tries at once,
    `~/save`, which writes the last proposal with its standard deviations to the file `output`, and
    `~/forget`, which begins with new frames.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        ChainIdentifierParameters: '',
        ManagedParameters: '',
    }

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('chain_identifier', **kwargs)

    def configure(self) -> None:
        """Listen to joints, and open the services."""
        settings = self.settings = current(self, ChainIdentifierParameters)
        check_names('parameter joint_names', settings.joint_names)
        self.found: Identification | None = None
        """The last proposal."""
        self._complaint = ''
        self._begin()
        self._tried = 0
        self._working: threading.Thread | None = None
        self._outcome: Identification | ValueError | None = None
        self._decoder = JointStateDecoder()
        self._encoders = EncoderMonitor(self.get_logger().warning)
        self.diagnostics = Diagnostics(self, 'identification', self.reporting(self._report))
        self._publisher = interfaces.IDENTIFIED_CHAIN.publisher(self)
        take = self.diagnostics.guarded('joint_states', self.while_active(self._take))
        StreamSubscription(self, interfaces.JOINT_STATES, take, self.diagnostics, raw=True)
        weigh = self.diagnostics.guarded('joint_state_deviations', self._weigh)
        interfaces.JOINT_STATE_DEVIATIONS.subscribe(self, self.while_active(weigh))
        interfaces.TILT.subscribe(self, self.while_active(self._note_tilt))
        interfaces.DELIVERED_IMPULSES.subscribe(self, self.while_active(self._note_delivered))
        interfaces.DELIVERY.subscribe(self, self.while_active(self._note_delivery))
        for topic in (interfaces.ROTOR_IMPULSES, interfaces.ROTOR_TORQUES):
            topic.subscribe(self, self.while_active(self._note_push))
        self.create_service(Trigger, '~/identify', self._on_identify)
        self.create_service(Trigger, '~/save', self._on_save)
        self.create_service(Trigger, '~/forget', self._on_forget)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_PERIOD, self._look, clock=steady)
        if settings.interval:
            self.create_timer(settings.interval, self._try, clock=steady)
        frames = self.resolve_topic_name(interfaces.JOINT_STATES.name)
        self.get_logger().info(f'identifying the chain of {frames}')

    @property
    def frames(self) -> int:
        """Number of frames since it began."""
        return self._record.frames

    def _begin(self) -> None:
        self._record = JointRecord(self.settings.joint_names, self.settings.most_frames)

    def _take(self, serialized: bytes) -> None:
        joints = self._decoder.decode(serialized)
        self._record.add(joints)
        self._encoders.check(joints.stamp, joints.position)

    def _weigh(self, message: JointState) -> None:
        self._record.add_deviations(joint_states_from_msg(message))

    def _note_push(self, message: RotorImpulses | JointState) -> None:
        self._record.add_push(message, self.get_clock().now().nanoseconds)

    def _note_delivered(self, message: RotorImpulses) -> None:
        self._record.add_delivered(message)

    def _note_delivery(self, message: Delivery) -> None:
        self._record.add_delivery(message)

    def _note_tilt(self, message: Float64) -> None:
        if math.isfinite(message.data):
            self._record.add_tilt(message.data, self.get_clock().now().nanoseconds)

    def _try(self) -> None:
        """Begin to identify the chain where there are new frames and nothing is under way."""
        record = self._record
        idle = self.active and not self._working and record.frames
        if not idle or record.frames == self._tried:
            return
        self._tried = record.frames
        given = dataclasses.replace(
            Chain(), spacing=self.settings.spacing, mass=self.settings.mass
        )
        gravity = Gravity(self.settings.gravity)
        work = record.readings(gravity), given, self.settings.tolerance or None
        self._working = threading.Thread(target=self._identify, args=work, daemon=True)
        self._working.start()

    def _identify(self, *given: Any) -> None:
        try:
            self._outcome = identify(*given)
        except ValueError as error:
            self._outcome = error

    def _look(self) -> None:
        """Publish what was found."""
        if self._working is None or self._working.is_alive():
            return
        outcome, self._working, self._outcome = self._outcome, None, None
        if not isinstance(outcome, Identification):
            self._complaint = str(outcome)
            return
        if not self.frames:
            return
        self.found, self._complaint = outcome, ''
        offsets = tuple(outcome.offsets.tolist())
        named = NamedChain(outcome.chain, self._record.joint_names, offsets)
        stamp = self.get_clock().now().to_msg()
        self._publisher.publish(chain_to_msg(named, stamp))
        for warning in outcome.warnings:
            self.get_logger().warning(warning)

    def _on_identify(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._tried = -1
        self._try()
        response.success = self._working is not None
        response.message = (
            f'identifying by {self.frames} frames; the chain will be on identified_chain'
            if response.success
            else 'there are no joint_states yet'
        )
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.found is None:
            response.message = self._complaint or 'no chain was identified yet'
            return response
        path = Path(self.settings.output)
        try:
            write_parameters(self.found, self._record.joint_names, self.get_name(), path)
        except OSError as error:
            response.message = f'{path}: {error.strerror}'
            return response
        response.success, response.message = True, f'written to {path}'
        return response

    def _on_forget(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._begin()
        self.found, self._complaint = None, ''
        response.success, response.message = True, 'begun with new frames'
        return response

    def _report(self) -> Report:
        values: dict[str, Any] = {
            'frames': self.frames,
            'frames left out': self.frames - len(self._record),
            'identifying': self._working is not None,
        }
        if self.found is None:
            message = self._complaint or 'waiting for a soliton to pass'
            return Report(message, values, bool(self._complaint))
        values |= {
            'noise [rad]': self.found.noise,
            'noise from frame to frame [rad]': self.found.reading_noise,
            'tolerance': self.found.tolerance,
            'worst bonds': ', '.join(map(str, self.found.worst_bonds[:3])),
        }
        words = f'a {self.found.chain.motion.value} of {self.found.chain.number_of_rotors} rotors'
        return Report('; '.join([words, *self.found.warnings]), values, bool(self.found.warnings))


def main() -> None:
    """Run the identifier until it is told to stop."""
    run(ChainIdentifier)
