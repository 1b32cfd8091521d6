# SPDX-License-Identifier: Apache-2.0
"""What a microcontroller and a computer tell each other, however it is written."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from soliton_linkage.linkage.chain import Array

SEQUENCES = 2**16
"""Numbers of frames [1], after which they begin anew: those of uint16_t."""
CLOCK_RANGE = 2**32
"""Range of a controller's clock [us], 71.6 minutes: that of micros() of Arduino."""


class FrameKind(Enum):
    """What the values of a frame are."""

    COUNTS = 'counts'
    """Readings of encoders [1]."""
    RADIANS = 'radians'
    """Angles [rad]."""
    HELLO = 'hello'
    """Nothing: the controller has begun anew."""
    TORQUES = 'torques'
    """Commands to the valves [N m]."""
    PRESSURES = 'pressures'
    """Commands to the valves [Pa]."""


READINGS = frozenset({FrameKind.COUNTS, FrameKind.RADIANS})
"""Kinds that a controller measures."""
COMMANDS = frozenset({FrameKind.TORQUES, FrameKind.PRESSURES})
"""Kinds that a controller is told."""


@dataclass(frozen=True, eq=False)
class SerialFrame:
    """One frame on the line."""

    kind: FrameKind
    sequence: int | None = None
    """Number of the frame modulo `SEQUENCES`, None where it is not told."""
    time: int | None = None
    """Of readings, when they were measured by the controller's clock, modulo `CLOCK_RANGE`, None
    where it is not told; of commands, for how long they hold [us]."""
    values: Array = field(default_factory=lambda: np.zeros(0))
    """One a rotor, NaN for one that is missing."""
