# SPDX-License-Identifier: Apache-2.0
"""The present state of one chain, and its packed pictures."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.live_view.frame_layout import ENERGIES, Column, Floats, pack
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND

MOST_ANGLES = 1500
"""Largest number of rotors drawn one by one; a page shows only the lean of more [1]."""
_GROUPS = 1024
"""Pairs of least and largest lean that represent a longer chain: a screen has few more pixels."""
_STATES_LAST = 1.0
"""Age of a state after which the analyser is silent [s]."""
_HISTORY_PERIOD = 1 / 30
"""Time between two columns of the history for pages that open later [s]."""
_HISTORY_COLUMNS = 600
"""Number of columns kept: 20 s."""
_HISTORY_NUMBERS = 400_000
"""Numbers in all columns [1], 1.6 MB: long chains have a shorter history."""


class ChainModel:
    """The newest messages about a chain, packed into pictures."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start without messages."""
        self.named: NamedChain | None = None
        self.complaint = ''
        """Reason why joint_states cannot be shown."""
        self.version = 0
        """Number of changes of `description`."""
        self.rate = math.nan
        """Rate of joint_states [Hz]."""
        self.frames = 0
        """Number of joint_states taken."""
        self.goal = math.nan
        """Goal of the present move [rotor spacings]."""
        self.history: deque[Column] = deque(maxlen=_HISTORY_COLUMNS)
        """Past of the chain for pages that open later."""
        self.stamp = math.nan
        """Stamp of the latest joint_states [s]."""
        self.angles = np.zeros(0)
        """Latest angles [rad], shape (N,), NaN for missing joints."""
        self.numbers: dict[str, float] = {}
        """Quantities of the latest soliton_state."""
        self._clock = clock
        self._reader: FrameReader | None = None
        self._rates: Array | None = None
        self._walls: list[float] = []
        self._taken_at = self._state_taken_at = -math.inf
        self._kept = -math.inf
        self._overview: Floats = np.zeros(0, dtype=np.float32)
        self._extensions = self._mode = np.zeros(0)
        self._counted: tuple[float, int] | None = None

    @property
    def rotors(self) -> int:
        """Number of rotors, 0 if unknown."""
        return len(self.angles) or (self.named.rotors if self.named else 0)

    @property
    def age(self) -> float:
        """Age of the latest joint_states [s], infinite before the first."""
        return self._clock() - self._taken_at

    @property
    def state_age(self) -> float:
        """Age of the latest soliton_state [s], infinite before the first."""
        return self._clock() - self._state_taken_at

    @property
    def behind(self) -> float:
        """Delay of soliton_state behind joint_states [s], NaN without an analyser."""
        now = self.state_age < _STATES_LAST
        return self.stamp - self._state_stamp if now else math.nan

    @property
    def _state_stamp(self) -> float:
        return self.numbers.get('state_stamp', self.stamp)

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on."""
        if named != self.named:
            self.named = named
            self._begin(FrameReader(named.joint_names))

    def take_joints(self, joints: JointStates) -> None:
        """Show joint states; set `complaint` if they cannot be shown."""
        known = self.named.joint_names if self.named else None
        try:
            if self._reader is None or (known is None and self._reader.joint_names != joints.name):
                self._begin(FrameReader(known or joints.name))
            if self._reader is not None:
                frame = self._reader.read(joints)
                self.angles, self._rates = frame.angles, frame.rates
        except ValueError as error:
            self._complain(str(error))
            return
        self._complain('')
        self.stamp = joints.stamp / SECOND
        self._taken_at = self._clock()
        self.frames += 1
        self._derive()

    def take_state(self, numbers: dict[str, float], walls: list[float]) -> None:
        """Show a state of the analyser."""
        self.numbers, self._walls = numbers, walls
        self._state_taken_at = self._clock()

    def count(self, sequence: int | None) -> None:
        """Measure the rate of joint_states by their sequence number."""
        now = self._clock()
        if sequence is None:
            return
        if self._counted is None or sequence < self._counted[1]:
            self._counted = (now, sequence)
        elif now - self._counted[0] > 1.0:
            self.rate = (sequence - self._counted[1]) / (now - self._counted[0])
            self._counted = (now, sequence)

    def picture(self, number: int, first: int, last: int) -> bytes:
        """Return a frame with the rotors from first to last, given the number in the list."""
        first = max(0, min(first, self.rotors - 1))
        last = max(first, min(last, self.rotors - 1))
        shown = slice(first, last + 1) if last - first < MOST_ANGLES else slice(0, 0)
        numbers = {
            **self.numbers,
            'chain': number,
            'version': self.version,
            'stamp': self.stamp,
            'age': self.age,
            'state_age': self.state_age,
            'state_stamp': self._state_stamp,
            'rotors': self.rotors,
            'first': first,
            'goal': self.goal,
        }
        arrays: dict[str, Array | Floats] = {
            'overview': self._overview,
            'angles': self.angles[shown],
            'extensions': self._extensions[shown],
            'mode': self._mode[shown],
            'places': np.array(self._walls),
        }
        return pack(numbers, arrays)

    def description(self) -> dict[str, Any]:
        """Return the constants of the chain for a page; NaN is null."""
        told: dict[str, Any] = {
            'version': self.version,
            'rotors': self.rotors,
            'complaint': self.complaint,
            'spacing': None,
            'joints': [],
        }
        if self._reader is not None:
            names = self._reader.joint_names
            told['joints'] = [names[0], names[-1]]
        if self.named is not None:
            chain = self.named.chain
            deviating = chain.deviations.rotor_length or chain.deviations.spacing
            told |= {
                'spacing': chain.spacing,
                'rotor_length': chain.rotor_length,
                'rest_angle': chain.rest_angle,
                'rest_length': chain.rest_length,
                'motion': chain.motion.value,
                'periodic': chain.periodic,
                'rest_lean': chain.rotor_length * math.sin(chain.rest_angle),
                'longest_rotor': float(chain.rotor_lengths.max()),
                'rotor_lengths': chain.rotor_lengths.tolist() if deviating else [],
                'pivots': np.append(0, np.cumsum(chain.spacings)).tolist() if deviating else [],
            }
        return told

    def _begin(self, reader: FrameReader) -> None:
        self._reader = reader
        self.angles = np.zeros(0)
        self._walls, self.numbers = [], {}
        self._state_taken_at = -math.inf
        self._overview = np.zeros(0, dtype=np.float32)
        self._extensions = self._mode = np.zeros(0)
        self._kept = -math.inf
        self.history.clear()
        self.version += 1

    def _complain(self, complaint: str) -> None:
        if complaint != self.complaint:
            self.complaint = complaint
            self.version += 1

    def _derive(self) -> None:
        """Compute the quantities of frames from the latest angles."""
        angles, chain = self.angles, self.named.chain if self.named else None
        lean = np.sin(angles) if chain is None else chain.positions(angles)[0]
        self._overview = overview(lean)
        if chain is not None:
            self._extensions = chain.spring_extensions(angles)
            self._mode = np.zeros(0)
            if not chain.periodic and np.isfinite(angles).all():
                self._mode = resolved_edge_mode(chain, angles, Edge.NEAREST)[1]
            if self.state_age > _STATES_LAST:
                self._walls = []
                self.numbers = {'elastic': float(chain.elastic_energy(angles))}
                if self._rates is not None:
                    self.numbers['kinetic'] = float(chain.kinetic_energy(self._rates))
        now = self._clock()
        if now - self._kept >= _HISTORY_PERIOD:
            self._kept = now
            place = self._walls[0] if self._walls else math.nan
            energies = [self.numbers.get(name, math.nan) for name in ENERGIES]
            numbers = (self.stamp, self._state_stamp, place, *energies)
            self.history.append(Column(numbers, self._overview))
            while len(self.history) * len(self._overview) > _HISTORY_NUMBERS:
                self.history.popleft()


def overview(lean: Array) -> Floats:
    """Return the lean of each rotor; of more than 2048, the least and largest of 1024 groups."""
    if len(lean) <= 2 * _GROUPS:
        return np.asarray(lean, dtype=np.float32)
    starts = np.linspace(0, len(lean), _GROUPS, endpoint=False).astype(np.intp)
    ends = np.minimum.reduceat(lean, starts), np.maximum.reduceat(lean, starts)
    return np.asarray(np.column_stack(ends).ravel(), dtype=np.float32)
