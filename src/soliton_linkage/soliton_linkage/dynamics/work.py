# SPDX-License-Identifier: Apache-2.0
"""Work of impulses and torques on a chain.

Constant torques tau do the work tau^T (phi(t_1) - phi(t_0)) from t_0 to t_1, for any motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain


def work_of_impulse(chain: Chain, rates: Array, impulses: Array) -> float:
    """Return the work [J] of impulses J [N m s], shape (N,), on the rotors of a chain of springs.

    The work is J^T (phi_dot + J / (2 I)) for the rates phi_dot [rad/s] before the impulses and the
    moments of inertia I.
    """
    return float(impulses @ (rates + impulses / (2 * chain.moments_of_inertia)))


@dataclass(frozen=True)
class TorqueTotals:
    """Impulse, work, peak and duration of the torques applied to a chain."""

    impulse: Array
    """Angular impulse on each rotor [N m s], shape (N,)."""
    work: float
    """Work on the chain [J]."""
    peak_torque: float
    """Largest norm of the vector of the torques on all rotors [N m]."""
    duration: float
    """Time during which a torque acted [s]."""


class TorqueLedger:
    """Sum of `TorqueTotals` over frames, with torques that are constant between frames."""

    def __init__(self, number_of_rotors: int) -> None:
        self.totals = TorqueTotals(np.zeros(number_of_rotors), 0.0, 0.0, 0.0)
        """Totals of all torques that have been added."""

    def add(self, torques: Array, turned: Array, time: float) -> None:
        """Add torques [N m] that acted for a time [s] while the rotors turned by angles [rad]."""
        before = self.totals
        norm = float(np.linalg.norm(torques))
        self.totals = TorqueTotals(
            before.impulse + torques * time,
            before.work + float(torques @ turned),
            max(before.peak_torque, norm),
            before.duration + time * (norm > 0),
        )
