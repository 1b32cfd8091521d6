# SPDX-License-Identifier: Apache-2.0
"""What is known of one chain, and the pictures that are made of it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.live_view.frame_layout import ENERGIES, Column, Floats, pack
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND

MOST_ANGLES = 1500
"""Rotors that are drawn one by one; of more a page shows how far they lean [1]."""
_GROUPS = 1024
"""Pairs of least and largest lean that stand for a longer chain: a screen has few more pixels."""
_STATES_LAST = 1.0
"""After which an analyser is silent [s]."""
_HISTORY_PERIOD = 1 / 30
"""Between two columns that are kept for a page that opens later [s]."""
_HISTORY_COLUMNS = 600
"""How many are kept: 20 s."""
_HISTORY_NUMBERS = 400_000
"""That these columns hold together [1], 1.6 MB: long chains have a shorter history."""


class ChainModel:
    """Takes what is heard of a chain, newest only, and packs pictures of it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Know nothing yet."""
        self.named: NamedChain | None = None
        self.complaint = ''
        """Why joint_states cannot be shown."""
        self.version = 0
        """Grows with each change of what `description` tells."""
        self.rate = math.nan
        """Of joint_states [Hz]."""
        self.frames = 0
        """How many joint_states were shown."""
        self.goal = math.nan
        """Of the move that is under way [rotor spacings]."""
        self.history: deque[Column] = deque(maxlen=_HISTORY_COLUMNS)
        """What a page that opens later is told of the past."""
        self._clock = clock
        self._reader: FrameReader | None = None
        self._angles = np.zeros(0)
        self._rates: Array | None = None
        self._numbers: dict[str, float] = {}
        self._walls: list[float] = []
        self._stamp = math.nan
        self._came = self._state_came = -math.inf
        self._kept = -math.inf
        self._overview: Floats = np.zeros(0, dtype=np.float32)
        self._extensions = self._mode = np.zeros(0)
        self._counted: tuple[float, int] | None = None

    @property
    def rotors(self) -> int:
        """How many there are, 0 where it is not known."""
        return len(self._angles) or (self.named.rotors if self.named else 0)

    @property
    def age(self) -> float:
        """Of the latest joint_states [s], infinite where none came."""
        return self._clock() - self._came

    @property
    def state_age(self) -> float:
        """Of the latest soliton_state [s], infinite where none came."""
        return self._clock() - self._state_came

    @property
    def behind(self) -> float:
        """By how much soliton_state is older than joint_states [s], NaN where none comes."""
        now = self.state_age < _STATES_LAST
        return self._stamp - self._state_stamp if now else math.nan

    @property
    def _state_stamp(self) -> float:
        return self._numbers.get('state_stamp', self._stamp)

    @property
    def stamp(self) -> float:
        """Of the latest joint_states [s]."""
        return self._stamp

    @property
    def angles(self) -> Array:
        """Latest angles [rad], shape (N,), NaN where they are not told."""
        return self._angles

    @property
    def numbers(self) -> Mapping[str, float]:
        """What the latest soliton_state says."""
        return self._numbers

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on."""
        if named != self.named:
            self.named = named
            self._begin(FrameReader(named.joint_names))

    def take_joints(self, joints: JointStates) -> None:
        """Show joint states; those that cannot be shown leave a complaint."""
        known = self.named.joint_names if self.named else None
        try:
            if self._reader is None or (known is None and self._reader.joint_names != joints.name):
                self._begin(FrameReader(known or joints.name))
            if self._reader is not None:
                frame = self._reader.read(joints)
                self._angles, self._rates = frame.angles, frame.rates
        except ValueError as error:
            self._complain(str(error))
            return
        self._complain('')
        self._stamp = joints.stamp / SECOND
        self._came = self._clock()
        self.frames += 1
        self._derive()

    def take_state(self, numbers: dict[str, float], walls: list[float]) -> None:
        """Show a state of the analyser."""
        self._numbers, self._walls = numbers, walls
        self._state_came = self._clock()

    def count(self, sequence: int | None) -> None:
        """Tell the rate of joint_states from their sequence number."""
        now = self._clock()
        if sequence is None:
            return
        if self._counted is None or sequence < self._counted[1]:
            self._counted = (now, sequence)
        elif now - self._counted[0] > 1.0:
            self.rate = (sequence - self._counted[1]) / (now - self._counted[0])
            self._counted = (now, sequence)

    def picture(self, number: int, first: int, last: int) -> bytes:
        """A frame of the chain of a number in the list, with the rotors from first to last."""
        first = max(0, min(first, self.rotors - 1))
        last = max(first, min(last, self.rotors - 1))
        shown = slice(first, last + 1) if last - first < MOST_ANGLES else slice(0, 0)
        numbers = {
            **self._numbers,
            'chain': number,
            'version': self.version,
            'stamp': self._stamp,
            'age': self.age,
            'state_age': self.state_age,
            'state_stamp': self._state_stamp,
            'rotors': self.rotors,
            'first': first,
            'goal': self.goal,
        }
        arrays: dict[str, Array | Floats] = {
            'overview': self._overview,
            'angles': self._angles[shown],
            'extensions': self._extensions[shown],
            'mode': self._mode[shown],
            'places': np.array(self._walls),
        }
        return pack(numbers, arrays)

    def description(self) -> dict[str, Any]:
        """What a page has to know of the chain besides its frames; NaN is null."""
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
        self._angles = np.zeros(0)
        self._walls, self._numbers = [], {}
        self._state_came = -math.inf
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
        """Compute what frames show of the latest angles."""
        angles, chain = self._angles, self.named.chain if self.named else None
        lean = np.sin(angles) if chain is None else chain.positions(angles)[0]
        self._overview = overview(lean)
        if chain is not None:
            self._extensions = chain.spring_extensions(angles)
            self._mode = np.zeros(0)
            if not chain.periodic and np.isfinite(angles).all():
                self._mode = resolved_edge_mode(chain, angles, Edge.NEAREST)[1]
            if self.state_age > _STATES_LAST:
                self._tell_energies()
        now = self._clock()
        if now - self._kept >= _HISTORY_PERIOD:
            self._kept = now
            place = self._walls[0] if self._walls else math.nan
            energies = [self._numbers.get(name, math.nan) for name in ENERGIES]
            numbers = (self._stamp, self._state_stamp, place, *energies)
            self.history.append(Column(numbers, self._overview))
            while len(self.history) * len(self._overview) > _HISTORY_NUMBERS:
                self.history.popleft()

    def _tell_energies(self) -> None:
        """Energies by the chain alone, where no analyser tells them."""
        if self.named is None:
            return
        chain, self._walls = self.named.chain, []
        self._numbers = {'elastic': float(chain.elastic_energy(self._angles))}
        if self._rates is not None:
            self._numbers['kinetic'] = float(chain.kinetic_energy(self._rates))


def overview(lean: Array) -> Floats:
    """Lean of each rotor, or of more than 2048 the least and the largest of 1024 groups."""
    if len(lean) <= 2 * _GROUPS:
        return np.asarray(lean, dtype=np.float32)
    starts = np.linspace(0, len(lean), _GROUPS, endpoint=False).astype(np.intp)
    ends = np.minimum.reduceat(lean, starts), np.maximum.reduceat(lean, starts)
    return np.asarray(np.column_stack(ends).ravel(), dtype=np.float32)
