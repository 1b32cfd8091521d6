# SPDX-License-Identifier: Apache-2.0
"""Present state of one chain, and conversion of the state to binary messages for the page."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.live_view.frame_layout import ENERGIES, Column, Floats, pack
from soliton_linkage_nodes.live_view.sharing import chain_constants, shared_page
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain
from soliton_linkage_nodes.messages.frames import FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND

MOST_ANGLES = 1500
"""Largest number of rotors that the page draws one by one [1]."""
_GROUPS = 1024
"""Number of rotor groups in the overview of a chain with more than twice as many rotors [1]."""
_STATE_TIMEOUT = 1.0
"""Age of the latest soliton_state above which the analyser counts as stopped [s]. Its solitons are
then no longer shown."""
_HISTORY_PERIOD = 1 / 30
"""Shortest time between two states in the history [s]."""
_HISTORY_COLUMNS = 600
"""Largest number of states in the history [1], sufficient for 20 s."""
_MINUTE = 60.0
"""Largest time span in the HTML file that a user can save [s]."""
_MINUTE_COLUMNS = round(_MINUTE / _HISTORY_PERIOD)
_MINUTE_NUMBERS = 1_800_000
"""Largest number of angles that are stored for the HTML file that a user can save [1] (7 MB of
memory). The file contains at most 850000 numbers; for more, it omits frames."""
_HISTORY_NUMBERS = 400_000
"""Largest number of values in the history [1] (1.6 MB). For a long chain this limit shortens the
history."""


class Moment(NamedTuple):
    """State of a chain at one past time."""

    stamp: float
    """Stamp of joint_states [s]."""
    angles: Floats
    """Angles [rad], shape (N,)."""
    solitons: list[float]
    """Flat list of three numbers per soliton: position [rotor spacings], standard deviation of the
    position [m] and charge."""
    energies: Mapping[str, float]
    """Numbers in the soliton_state by name. Among them are the `ENERGIES` [J]."""


class ChainModel:
    """Present state of one chain according to the newest messages, and the recent history."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.named: NamedChain | None = None
        self.error = ''
        """Reason why joint_states cannot be shown, or ''."""
        self.version = 0
        self.rate = math.nan
        self.frames = 0
        self.goal = math.nan
        """Goal of the current move [rotor spacings]."""
        self.bag_time = math.nan
        """Position of the replay, from the start of the bag [s]; NaN without a replay."""
        self.history: deque[Column] = deque(maxlen=_HISTORY_COLUMNS)
        """Recent states. A newly opened page starts with them."""
        self.stamp = math.nan
        self.rates: Array | None = None
        """Latest angular velocities [rad/s], shape (N,), or None if they are not published."""
        self._minute: deque[Moment] = deque()
        self._clock = clock
        self._reader: FrameReader | None = None
        self._received_at = -math.inf
        self._column_stamp = math.nan
        self._counted: tuple[float, int] | None = None
        self._clear()

    @property
    def rotors(self) -> int:
        """Number of rotors, or 0 if the number is unknown."""
        return len(self.angles) or (self.named.rotors if self.named else 0)

    @property
    def state_age(self) -> float:
        """Age of the latest soliton_state [s]; infinite before the first one."""
        return self._clock() - self._state_received_at

    @property
    def delay(self) -> float:
        """Stamp of the shown joint_states minus stamp of the shown soliton_state [s].

        It is NaN if the latest soliton_state is 1 s old or older.
        """
        return self.stamp - self._state_stamp if self.state_age < _STATE_TIMEOUT else math.nan

    @property
    def _state_stamp(self) -> float:
        return self.numbers.get('state_stamp', self.stamp)

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain and its joint names. If the chain changes, the history is deleted."""
        if named != self.named:
            self.named = named
            self._reset(FrameReader(named.joint_names))

    def update_joints(self, joints: JointStates) -> None:
        """Store new joint states. If they cannot be shown, only set `error`."""
        known = self.named.joint_names if self.named else None
        try:
            if self._reader is None or (known is None and self._reader.joint_names != joints.name):
                self._reset(FrameReader(known or joints.name))
            if self._reader is not None:
                frame = self._reader.read(joints)
                self.angles, self.rates = frame.angles, frame.rates
        except ValueError as error:
            self._set_error(str(error))
            return
        self._set_error('')
        self.stamp = joints.stamp / SECOND
        self._received_at = self._clock()
        self.frames += 1
        self._update_derived()

    def extend_history(self, joints: JointStates, numbers: Mapping[str, float]) -> None:
        """Add joint states to the history without showing them.

        The history has at most 30 states per second. `numbers` are the values of the soliton_state
        with the same stamp.
        """
        stamp = joints.stamp / SECOND
        if self._reader is None or not stamp >= self._column_stamp + _HISTORY_PERIOD:
            return
        try:
            angles = self._reader.read(joints).angles
        except ValueError:
            return
        self._add_column(stamp, numbers, overview(self._lean(angles)))

    def clear_state(self) -> None:
        """Delete the values of the last soliton_state."""
        self.numbers: dict[str, float] = {}
        self._solitons: list[float] = []
        self._state_received_at = -math.inf

    def update_state(self, numbers: dict[str, float], solitons: list[float]) -> None:
        """Store the values of a soliton_state. `solitons` is a list like `Moment.solitons`."""
        self.numbers, self._solitons = numbers, solitons
        self._state_received_at = self._clock()

    def update_rate(self, sequence: int | None) -> None:
        """Update the number of joint_states per second from the sequence number of a message.

        If `sequence` is None, nothing changes.
        """
        now = self._clock()
        if sequence is None:
            return
        if self._counted is None or sequence < self._counted[1]:
            self._counted = (now, sequence)
        elif now - self._counted[0] > 1.0:
            self.rate = (sequence - self._counted[1]) / (now - self._counted[0])
            self._counted = (now, sequence)

    def packed(self, index: int, first: int, last: int) -> bytes:
        """Return the present state as a binary message of the kind 'frame' for the page.

        The message contains an overview of all rotors. It also contains angle, spring extension
        and zero mode of each rotor from `first` to `last` (inclusive), but not if these are more
        than 1500 rotors. `index` is the index of the chain in the list of chains that the page
        receives.
        """
        first = max(0, min(first, self.rotors - 1))
        last = max(first, min(last, self.rotors - 1))
        shown = slice(first, last + 1) if last - first < MOST_ANGLES else slice(0, 0)
        numbers = {
            **self.numbers,
            'chain': index,
            'stamp': self.stamp,
            'age': self._clock() - self._received_at,
            'state_age': self.state_age,
            'state_stamp': self._state_stamp,
            'rotors': self.rotors,
            'first': first,
            'goal': self.goal,
            'bag_time': self.bag_time,
        }
        arrays: dict[str, Array | Floats] = {
            'overview': self._overview,
            'angles': self.angles[shown],
            'extensions': self._extensions[shown],
            'mode': self._mode[shown],
            'solitons': np.array(self._solitons),
        }
        return pack(numbers, arrays)

    def description(self) -> dict[str, Any]:
        """Return the chain parameters that the page needs for drawing, as JSON values.

        If the chain is unknown, `spacing` is None.
        """
        if self.named is None:
            return {'error': self.error, 'spacing': None}
        constants = chain_constants(self.named.chain)
        return {'error': self.error, 'rotors': self.named.rotors, **constants}

    def shared(self, title: str) -> str:
        """Return an HTML page that shows the last minute of the chain.

        Raises ValueError if the chain is unknown or no frame has arrived.
        """
        if self.named is None:
            raise ValueError('the chain is unknown: no node publishes the topic chain')
        recent = list(self._minute)
        names = [name for name in ENERGIES if any(name in each.energies for each in recent)]
        return shared_page(
            title,
            self.named.chain,
            np.array([each.stamp for each in recent]),
            np.array([each.angles for each in recent]),
            [each.solitons for each in recent],
            {
                name: np.array([each.energies.get(name, math.nan) for each in recent])
                for name in names
            },
        )

    def _reset(self, reader: FrameReader) -> None:
        self._reader = reader
        self._clear()
        self.version += 1

    def _clear(self) -> None:
        self.angles = np.zeros(0)
        """Latest angles [rad], shape (N,). The angles of missing joints are NaN."""
        self.clear_state()
        self._column_at = -math.inf
        self._overview: Floats = np.zeros(0, dtype=np.float32)
        self._extensions = self._mode = np.zeros(0)
        self.history.clear()
        self._minute.clear()

    def _set_error(self, error: str) -> None:
        self.version += error != self.error
        self.error = error

    def _update_derived(self) -> None:
        angles, chain = self.angles, self.named.chain if self.named else None
        self._overview = overview(self._lean(angles))
        if chain is not None:
            self._extensions = chain.spring_extensions(angles)
            self._mode = np.zeros(0)
            if not chain.periodic and np.isfinite(angles).all():
                self._mode = resolved_edge_mode(chain, angles, Edge.NEAREST)[1]
            if self.state_age > _STATE_TIMEOUT:
                self._solitons = []
                self.numbers = {'elastic': float(chain.elastic_energy(angles))}
                if self.rates is not None:
                    self.numbers['kinetic'] = float(chain.kinetic_energy(self.rates))
        now = self._clock()
        if now - self._column_at >= _HISTORY_PERIOD:
            self._column_at = now
            self._add_column(self.stamp, self.numbers, self._overview)
            self._minute.append(
                Moment(self.stamp, angles.astype(np.float32), self._solitons, self.numbers)
            )
            most = min(_MINUTE_COLUMNS, _MINUTE_NUMBERS // len(angles))
            while len(self._minute) > most or self._minute[0].stamp < self.stamp - _MINUTE:
                self._minute.popleft()

    def _lean(self, angles: Array) -> Array:
        return self.named.chain.positions(angles)[0] if self.named else np.sin(angles)

    def _add_column(self, stamp: float, numbers: Mapping[str, float], column: Floats) -> None:
        self._column_stamp = stamp
        values = (numbers.get(name, math.nan) for name in ('rotor', *ENERGIES))
        state_stamp = numbers.get('state_stamp', stamp)
        self.history.append(Column((stamp, state_stamp, *values), column))
        while len(self.history) * len(column) > _HISTORY_NUMBERS:
            self.history.popleft()


def overview(lean: Array) -> Floats:
    """Return the displacements of the rotor tips along the chain, `lean`, or a summary of them.

    If the chain has more than 2048 rotors, the summary contains the smallest and the largest
    displacement in each of 1024 groups of neighbouring rotors.
    """
    if len(lean) <= 2 * _GROUPS:
        return np.asarray(lean, dtype=np.float32)
    starts = np.linspace(0, len(lean), _GROUPS, endpoint=False).astype(np.intp)
    ends = np.minimum.reduceat(lean, starts), np.maximum.reduceat(lean, starts)
    return np.asarray(np.column_stack(ends).ravel(), dtype=np.float32)
