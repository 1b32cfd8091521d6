# SPDX-License-Identifier: Apache-2.0
"""The ledger of a simulator: what commands have done to the chain, frame by frame."""

from __future__ import annotations

import numpy as np
from rclpy.node import Node

from soliton_linkage.actuation.kick_record import Delivered
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage_nodes.messages.command_conversions import delivery_to_msg
from soliton_linkage_nodes.runtime import interfaces


class DeliveryPublisher:
    """Publishes `delivery` for each frame that impulses or torques had a part in.

    Torques are the same from frame to frame, so that their work is torque times angle turned,
    exactly. The ledger goes on through resets, which put another simulation in the place of one.
    """

    def __init__(self, node: Node, number_of_rotors: int, stamp: int) -> None:
        """Publish that nothing has been done; stamp [ns]."""
        self._publisher = interfaces.DELIVERY.publisher(node)
        self._delivered = Delivered(stamp, 0, 0.0, False, 0.0, np.zeros(number_of_rotors))
        self._simulation: Simulation | None = None
        self._angles = self._torques = np.zeros(number_of_rotors)
        self._kicks, self._kick_work = 0, 0.0
        self._seen = (0, 0.0)
        self._publisher.publish(delivery_to_msg(self._delivered))

    def note(self, stamp: int, simulation: Simulation) -> None:
        """Enter the period that ends with a frame: its stamp [ns], after what acts from it on.

        What came to act at the instant of the frame is entered with the next one.
        """
        if simulation is not self._simulation:
            self._simulation = simulation
            self._angles, self._torques = simulation.angles, 0 * self._torques
            self._seen = (0, 0.0)
        before = self._delivered
        acting = bool(self._torques.any())
        if acting or before.torques_act or self._kicks:
            turned = simulation.angles - self._angles
            self._delivered = Delivered(
                stamp,
                before.impulses + self._kicks,
                before.work_of_impulses + self._kick_work,
                acting,
                before.work_of_torques + float(self._torques @ turned),
                before.impulse_of_torques + self._torques * simulation.period,
            )
            self._publisher.publish(delivery_to_msg(self._delivered))
        self._angles, self._torques = simulation.angles, simulation.torques
        kicks, work = self._seen
        self._kicks, self._kick_work = simulation.kicks - kicks, simulation.kick_work - work
        self._seen = (simulation.kicks, simulation.kick_work)
