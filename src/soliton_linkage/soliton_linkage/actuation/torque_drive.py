# SPDX-License-Identifier: Apache-2.0
"""All the torques that are asked for, at the edges and joint by joint, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.actuation.actuator import Actuator
from soliton_linkage.actuation.edge_drive import EdgeDrive
from soliton_linkage.actuation.joint_drive import JointDrive
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class DriveTorques:
    """Torques to hold until the next frame."""

    torques: Array
    """On each rotor [N m], shape (N,)."""
    saturated: bool
    """Whether an actuator at an edge gives less than its level asks for."""


class TorqueDrive:
    """The actuators at the edges and those on single rotors together."""

    def __init__(self, chain: Chain, actuator: Actuator, timeout: float) -> None:
        """Start at rest; `timeout` [s] is for torques on single rotors, 0 for none."""
        self.chain = chain
        self.edges = EdgeDrive(actuator)
        self.joints = JointDrive(chain.number_of_rotors, timeout)

    @property
    def active(self) -> bool:
        """Whether there is a torque now or later."""
        return self.edges.active or self.joints.active

    def unfinished(self, time: float) -> bool:
        """Whether something with an end has not come to it at an instant [s]."""
        return self.edges.unfinished(time) or self.joints.unfinished(time)

    def drop(self, time: float) -> None:
        """End all that is asked for at an instant [s]; actuators go back to rest."""
        self.edges.drop(time)
        self.joints.drop()

    def torques(self, angles: Array, start: float, end: float) -> DriveTorques:
        """Torques for a configuration [rad], means over a stretch of time that begins now [s].

        Held for as long as that, they give each rotor the impulse that is asked for, however
        short pulses and ramps are.
        """
        torques = self.joints.mean_torques(start, end)
        edge = self.edges.mean_torque(start, end)
        if edge.torque:
            torques += edge.torque * mode_towards_last(self.chain, angles)
        return DriveTorques(torques, edge.saturated)
