# SPDX-License-Identifier: Apache-2.0
"""Commands to the actuators of a chain. Each command is either executed completely or rejected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.chain_driver import ChainDriver
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand, EdgeLimits
from soliton_linkage.actuation.waveform import DrivenQuantity, Waveform
from soliton_linkage.dynamics.work import work_of_impulse
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.edge_actuator.topics import ActuatorPublishers, LatestFrames
from soliton_linkage_nodes.messages import command_conversions as conversions
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime.stamps import time_from_msg

_MOST_KICKS_WAITING = 50
"""Largest number of published kicks that the simulator has not yet executed [1]. Further kicks are
rejected. The number is half the queue depth of `rotor_impulses`, which leaves a margin so that no
accepted kick is lost."""


@dataclass(frozen=True)
class EdgeActuatorParameters:
    """Parameters of the node, without the parameters of the chain and of the actuators."""

    actuator: str = quantity('pneumatic', 'kind of the actuators at the edges')
    nudge_edge: str = quantity(
        'nearest',
        'edge of nudges; nearest is the edge nearer to the zero mode',
        choices=tuple(edge.value for edge in Edge),
        adjustable=True,
    )
    nudge_as: str = quantity(
        'kick',
        'effect of a nudge: an instantaneous kick, or a pressure with the same impulse',
        choices=(CommandKind.KICK.value, CommandKind.PRESSURE.value),
        adjustable=True,
    )
    nudge_duration: float = quantity(
        0.1, 'duration of the pressure of a nudge', 's', 1e-3, 60.0, adjustable=True
    )
    state_timeout: float = quantity(
        0.2, 'age of joint_states above which commands are rejected', 's', 1e-3, 60.0
    )
    command_timeout: float = quantity(
        0.5,
        'time for which torques of joints are held without a new command, and largest age of a '
        'command; 0 for no limit',
        's',
        0.0,
        86_400.0,
    )
    longest_command: float = quantity(
        600.0,
        'largest duration of a command, and largest time from now to its stamp',
        's',
        1e-3,
        86_400.0,
    )
    speed_limit: float = quantity(100.0, 'largest speed of a kick', 'rad/s', 0.0, 1e6)
    torque_limit: float = quantity(
        0.1,
        'largest torque of a pulse along the unit zero mode, and of a joint without its own limit',
        'N m',
        0.0,
        1e6,
    )
    joints: tuple[str, ...] = quantity((), 'joints with an actuator; empty for all joints')


@dataclass(frozen=True)
class ActuatedChain:
    """Chain, the actuators of its joints, and the driver that computes their torques."""

    named: NamedChain
    joints: conversions.JointActuators
    driver: ChainDriver


class Commands:
    """Execution of the commands to a chain.

    Each method executes a command from the topic `source`. If the command is invalid, or if it
    cannot act on the chain now, the method raises ValueError.
    """

    def __init__(
        self,
        settings: EdgeActuatorParameters,
        actuator: Actuator,
        frames: LatestFrames,
        publishers: ActuatorPublishers,
    ) -> None:
        """Create the object without a chain. All commands are rejected until `chain` is set."""
        self.settings = settings
        self.chain: ActuatedChain | None = None
        self._actuator = actuator
        self._limits = EdgeLimits(settings.speed_limit, settings.torque_limit)
        self._frames = frames
        self._publishers = publishers

    def nudge(self, source: str, message: Float64) -> None:
        """Apply a kick at the edge that the parameter `nudge_edge` selects.

        The value of the message is the change of the speed along the unit zero mode [rad/s]. If
        the parameter `nudge_as` is 'pressure', a constant pressure is commanded to the actuator
        for `nudge_duration` instead. It causes the same impulse.
        """
        kick = EdgeCommand(Edge(self.settings.nudge_edge), CommandKind.KICK, message.data)
        if self.settings.nudge_as == CommandKind.KICK.value:
            self._command(source, kick)
            return
        kick.check(self._limits, self._actuator)
        chain = self._ready().named.chain
        duration = self.settings.nudge_duration
        self._command(source, kick.as_pressure(chain, self._actuator, duration))

    def edge_command(self, source: str, message: msg.EdgeCommand) -> None:
        """Execute a command to the actuator at an edge."""
        command = conversions.edge_command_from_msg(message)
        self._check_made(message.header.stamp)
        self._rule.check_length(source, command.length)
        if command.waveform is None:
            self._command(source, command)
        else:
            self._play(source, command, command.waveform)

    def joint_commands(self, source: str, message: JointState) -> None:
        """Apply constant torques to the joints that the message names.

        The torque of a joint ends at the next command for this joint, or after `command_timeout`.
        The torques of all other joints do not change.
        """
        chain = self._ready()
        rotors, torques = conversions.efforts_from_msg(chain.joints, source, message)
        self._check_made(message.header.stamp)
        self._frames.check_fresh()
        chain.driver.hold(source, rotors, torques)

    def efforts(self, source: str, message: Float64MultiArray) -> None:
        """Apply constant torques to all joints with an actuator.

        The torque of a joint ends at the next command for this joint, or after `command_timeout`.
        """
        chain = self._ready()
        rotors, torques = conversions.efforts_from_array(chain.joints, source, message)
        self._frames.check_fresh()
        chain.driver.hold(source, rotors, torques)

    def trajectory(self, source: str, message: JointTrajectory) -> None:
        """Apply torques to joints, interpolated linearly between the points of a trajectory.

        The torques of the last point are held for `command_timeout`. A trajectory without points
        ends the torques of the joints that it names. If it names no joint, it ends the torques of
        all joints.
        """
        chain = self._ready()
        if not message.points:
            names = message.joint_names or chain.joints.names
            chain.driver.hold(source, *chain.joints.checked(source, names, np.zeros(len(names))))
            return
        rotors, times, torques = conversions.trajectory_from_msg(chain.joints, source, message)
        made = time_from_msg(message.header.stamp)
        delay = self._rule.delay(source, made, self._publishers.now, float(times[-1]))
        self._frames.check_fresh()
        chain.driver.follow(source, rotors, times, torques, delay)

    def _check_made(self, stamp: Time) -> None:
        self._rule.check_at_once('the command', time_from_msg(stamp), self._publishers.now)

    @property
    def _rule(self) -> conversions.StampRule:
        return conversions.StampRule(self.settings.command_timeout, self.settings.longest_command)

    def _command(self, source: str, command: EdgeCommand) -> None:
        command.check(self._limits, self._actuator)
        chain = self._ready(command.instantaneous)
        frame, stamp = self._frames.read(chain.named)
        linkage, angles = chain.named.chain, frame.angles
        side, mode = resolved_edge_mode(linkage, angles, command.edge, anywhere=command.vents)
        meant = replace(command, edge=side)
        if command.instantaneous:
            period = None
            if command.kind is not CommandKind.KICK:
                period = self._frames.period(stamp)
            impulses = meant.impulses(linkage, mode, period)
            record = chain.driver.record
            if record.waiting >= _MOST_KICKS_WAITING:
                raise ValueError(
                    f'{record.waiting} kicks wait for the simulator, the limit is '
                    f'{_MOST_KICKS_WAITING}; kick less often'
                )
            self._publishers.kick(chain.named, impulses)
            rates = np.zeros_like(impulses) if frame.rates is None else frame.rates
            work = work_of_impulse(linkage, rates, impulses)
            record.measured = self._publishers.measured
            record.kicked(stamp, source, meant, impulses, work)
        else:
            chain.driver.command(source, meant, side)

    def _play(self, source: str, command: EdgeCommand, waveform: Waveform) -> None:
        command.check(self._limits, self._actuator)
        chain = self._ready()
        named, joints = chain.named, chain.joints
        frame, _ = self._frames.read(named)
        joint, side = waveform.joint, command.edge
        if not joint:
            side, _ = resolved_edge_mode(named.chain, frame.angles, side, anywhere=True)
            joint = named.joint_names[0 if side is Edge.FIRST else -1]
        torque = command.value if waveform.quantity is DrivenQuantity.TORQUE else 0.0
        (rotor,), _ = joints.checked(source, [joint], np.array([torque]))
        limit = float(joints.limits[joints.names.index(joint)])
        chain.driver.play(source, replace(command, edge=side), int(rotor), limit)

    def _ready(self, at_once: bool = False) -> ActuatedChain:
        """Return the chain; ValueError if it is unknown or nothing subscribes to the topic.

        The topic is `rotor_impulses` if `at_once` is set, otherwise `rotor_torques`.
        """
        self._publishers.check_connected(at_once)
        if self.chain is None:
            raise ValueError('the chain is unknown; publish chain or set chain_from to parameters')
        return self.chain
