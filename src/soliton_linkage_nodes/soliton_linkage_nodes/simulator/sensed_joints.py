# SPDX-License-Identifier: Apache-2.0
"""Joint states of a simulation as its sensors show them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.encoders import EncoderErrors, Encoders
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.messages.conversions import NamedChain


class SensedJoints:
    """Serialized joint states: angles and rates with the errors of encoders, exact torques.

    Without errors, angles and rates are exact. Missing joints are left out of every message.
    Readings are too large by the known offsets of the chain's encoders, and by their errors.
    """

    def __init__(
        self, named: NamedChain, period: float, errors: EncoderErrors, missing: Collection[int]
    ) -> None:
        """Lay out the message; frames are a period [s] apart, missing joints given by number."""
        shown = [rotor for rotor in range(named.rotors) if rotor not in missing]
        names = tuple(named.joint_names[rotor] for rotor in shown)
        self._shown = np.array(shown, dtype=np.intp) if missing else None
        self._buffer = JointStateBuffer(NamedChain(named.chain, names))
        self._known = named.encoder_offsets
        self._encoders = Encoders(named.rotors, period, errors)
        self.change(errors)
        self._seen: Simulation | None = None

    def __len__(self) -> int:
        """Size of the message in bytes."""
        return len(self._buffer)

    def change(self, errors: EncoderErrors) -> None:
        """Let the next frame have other errors."""
        if self._known:
            offsets = np.add(self._known, errors.offsets or 0.0)
            errors = replace(errors, offsets=tuple(offsets.tolist()))
        self._encoders.errors = errors
        self._exact = errors.none

    def fill(self, stamp: int, frame: int, simulation: Simulation) -> bytearray:
        """Return the message for a frame, given its stamp [ns] and number.

        The next frame overwrites it. Rates begin anew with another simulation, as after a reset.
        """
        angles, rates = simulation.angles, simulation.rates
        if not self._exact:
            if simulation is not self._seen:
                self._encoders.forget()
                self._seen = simulation
            angles, rates = self._encoders.read(frame, angles)
        shown, torques = self._shown, simulation.link_torques
        if shown is not None:
            angles, rates, torques = angles[shown], rates[shown], torques[shown]
        return self._buffer.fill(stamp, angles, rates, torques)
