# SPDX-License-Identifier: Apache-2.0
"""What impulses and torques have done to a chain, reckoned from its frames.

A torque tau that is the same from one frame to the next does the work

    W = integral of tau . phi_dot dt = tau . (phi(t_1) - phi(t_0)),

whatever the chain does in between, so that frames of exact angles give exact work. An impulse J
that acts at an instant does W = J . (phi_dot before + phi_dot after) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class Account:
    """What torques have done."""

    impulse: Array
    """Angular impulse on each rotor [N m s], shape (N,)."""
    work: float
    """Work on the chain [J]."""
    peak_torque: float
    """Largest torque, the norm over the rotors [N m]."""
    duration: float
    """How long there was a torque [s]."""


class TorqueBooks:
    """Adds up what torques that are constant between frames do to the rotors."""

    def __init__(self, number_of_rotors: int) -> None:
        """Start with nothing done."""
        self.clear(number_of_rotors)

    def clear(self, number_of_rotors: int) -> None:
        """Start anew, maybe with another chain."""
        self._account = Account(np.zeros(number_of_rotors), 0.0, 0.0, 0.0)

    @property
    def account(self) -> Account:
        """What was done so far."""
        return self._account

    def add(self, torques: Array, turned: Array, time: float) -> None:
        """Book torques [N m] that acted for a time [s] while the rotors turned [rad], (N,)."""
        before = self._account
        norm = float(np.linalg.norm(torques))
        self._account = Account(
            before.impulse + torques * time,
            before.work + float(torques @ turned),
            max(before.peak_torque, norm),
            before.duration + time * (norm > 0),
        )


def work_of_impulse(chain: Chain, rates: Array, impulses: Array) -> float:
    """Work of impulses J [N m s] on a chain of springs at rates [rad/s], shape (N,) each, [J].

    J . phi_dot + sum_n J_n^2 / (2 I_n): the rates change by J / I at once.
    """
    return float(impulses @ (rates + impulses / (2 * chain.moments_of_inertia)))
