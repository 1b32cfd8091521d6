# SPDX-License-Identifier: Apache-2.0
"""What happens to walls: they come and go, turn back, meet and part."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class EventKind(enum.Enum):
    """What happened."""

    FOUND = 'found'
    """A wall that was there before, or of which no frame showed how it came."""
    LOST = 'lost'
    """A wall of which no frame showed how it went."""
    BIRTH_AT_EDGE = 'birth at an edge'
    """A wall came from an edge."""
    DEATH_AT_EDGE = 'death at an edge'
    """A wall went into an edge and did not come back."""
    REFLECTION = 'reflection'
    """A wall came back from an edge."""
    BIRTH_OF_PAIR = 'birth of a pair'
    """A kink and an anti-kink came from one place."""
    ANNIHILATION = 'annihilation'
    """A kink and an anti-kink went up in waves."""
    BOUNCE = 'bounce'
    """A kink and an anti-kink met and parted, each on its side."""
    PASSING = 'passing'
    """A kink and an anti-kink passed through each other and exchanged their charges."""
    BREATHER_FORMED = 'breather formed'
    """A kink and an anti-kink swing about each other."""
    BREATHER_DECAYED = 'breather decayed'
    """They do so no more."""


@dataclass(frozen=True)
class SolitonEvent:
    """An event, told with the frame that made sure of it.

    kind: what happened.
    time: when it did [s], on the clock of the frames from the first on.
    rotor: where it did [rotor spacings].
    ids_before: who took part, from rotor 0 on; for a breather its own.
    ids_after: who was there afterwards.
    charge_before: sum of the charges of those before.
    charge_after: sum of the charges of those afterwards.
    energy_before: energy within reach of those before [J], as they were free; NaN if unknown.
    energy_after: energy within reach of those afterwards [J].
    collisions: how often two overlapped.
    """

    kind: EventKind
    time: float
    rotor: float
    ids_before: tuple[int, ...] = ()
    ids_after: tuple[int, ...] = ()
    charge_before: int = 0
    charge_after: int = 0
    energy_before: float = 0.0
    energy_after: float = 0.0
    collisions: int = 0
