# SPDX-License-Identifier: Apache-2.0
"""What acts on a chain does work on it; here it is reckoned, added up, and held against energy.

A kick, impulses J that act at an instant, does the work W = J . (phi_dot before + after) / 2.
A torque tau that is the same from one instant to another does

    W = integral of tau . phi_dot dt = tau . (phi(t_1) - phi(t_0)),

whatever the chain does in between, so that frames of exact angles give exact work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain


def work_of_kick(impulses: Array, before: Array, after: Array) -> float:
    """Work of impulses [N m s] that change rates [rad/s], shape (N,) each, [J]."""
    return float(np.add.reduce(impulses * (before + after))) / 2


def work_of_impulse(chain: Chain, rates: Array, impulses: Array) -> float:
    """Work of impulses J [N m s] on a chain of springs at rates [rad/s], shape (N,) each, [J].

    J . phi_dot + sum_n J_n^2 / (2 I_n): the rates change by J / I at once.
    """
    return float(impulses @ (rates + impulses / (2 * chain.moments_of_inertia)))


def work_of_torques(torques: Array, turned: Array) -> float:
    """Work of torques [N m] while rotors turn by angles [rad], shape (N,) each, [J]."""
    return float(torques @ turned)


@dataclass(frozen=True)
class TorqueTotals:
    """What torques have done."""

    impulse: Array
    """Angular impulse on each rotor [N m s], shape (N,)."""
    work: float
    """Work on the chain [J]."""
    peak_torque: float
    """Largest torque, the norm over the rotors [N m]."""
    duration: float
    """How long there was a torque [s]."""


class TorqueLedger:
    """Adds up what torques that are constant between frames do to the rotors."""

    def __init__(self, number_of_rotors: int) -> None:
        """Start with nothing done."""
        self._totals = TorqueTotals(np.zeros(number_of_rotors), 0.0, 0.0, 0.0)

    @property
    def totals(self) -> TorqueTotals:
        """What was done so far."""
        return self._totals

    def add(self, torques: Array, turned: Array, time: float) -> None:
        """Enter torques [N m] that acted for a time [s] while the rotors turned [rad], (N,)."""
        before = self._totals
        norm = float(np.linalg.norm(torques))
        self._totals = TorqueTotals(
            before.impulse + torques * time,
            before.work + work_of_torques(torques, turned),
            max(before.peak_torque, norm),
            before.duration + time * (norm > 0),
        )
