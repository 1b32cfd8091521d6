# SPDX-License-Identifier: Apache-2.0
"""Layout of the binary messages to the page: frames, histories and camera pictures.

All numbers are little-endian. The first double is the kind of the message, an index of `KINDS`. In
a frame, the next doubles are the values of the `FIELDS` and the lengths of the `ARRAYS`. The
arrays follow as float32.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

Floats = NDArray[np.float32]

KINDS = ('frame', 'history', 'camera')
FRAME, HISTORY, CAMERA = map(float, range(len(KINDS)))
ENERGIES = ('kinetic', 'elastic', 'wall_energy', 'wake_energy')
"""Energies that the page plots over time [J]."""
FIELDS = (
    'chain',  # index of the chain in the status
    'stamp',  # stamp of joint_states [s]
    'age',  # age of joint_states when the frame is packed [s]; infinite before the first message
    'state_age',  # age of soliton_state [s]
    'state_stamp',  # stamp of soliton_state [s]; without soliton_state the stamp of joint_states
    'rotors',
    'first',  # rotor of the first element of `angles`
    'rotor',
    'position_deviation',
    'velocity',
    'walls',
    'phase',
    'phase_rate',
    'completed',
    'leg',
    *ENERGIES,
    'winding_before',
    'winding_beyond',
    'charge',
    'zero_mode_rotor',
    'bag_time',  # position of the replay, from the start of the bag [s]; NaN without a replay
    'goal',  # goal of the current move [rotor spacings]
)
ARRAYS = (
    'overview',  # tip displacement u of each rotor along the chain [m]; see chain_model.overview
    'angles',  # angles of the shown rotors [rad]; empty if too many rotors are shown
    'extensions',  # extension of the spring after each shown rotor [m]
    'mode',  # component of the zero mode at each shown rotor [1]
    'solitons',  # position [rotor spacings], standard deviation [m] and charge of each soliton
)
LAYOUT = {'kinds': KINDS, 'fields': FIELDS, 'arrays': ARRAYS, 'energies': ENERGIES}


class Column(NamedTuple):
    """State of a chain at one past time."""

    numbers: tuple[float, ...]
    """Stamp of the angles [s], stamp of the state [s], position of the soliton nearest to rotor 0
    [rotor spacings], and the `ENERGIES` [J]. Unknown values are NaN."""
    overview: Floats
    """The array `overview` in `ARRAYS`."""


def pack(numbers: Mapping[str, float], arrays: Mapping[str, Array | Floats]) -> bytes:
    """Return a frame as bytes. Missing fields are NaN, and missing arrays are empty."""
    empty = np.zeros(0, dtype='<f4')
    with np.errstate(over='ignore'):
        parts = [np.asarray(arrays.get(name, empty), dtype='<f4') for name in ARRAYS]
    head = [FRAME, *(numbers.get(name, np.nan) for name in FIELDS)]
    head += [float(part.size) for part in parts]
    return b''.join([np.array(head, dtype='<f8').tobytes(), *(part.tobytes() for part in parts)])


def pack_history(chain: int, columns: Iterable[Column]) -> bytes:
    """Return a message with the past states of a chain, `columns`.

    `chain` is the index of the chain in the list of chains that the page receives. The message
    begins with five doubles: kind, chain index, number of columns, length of `overview` and length
    of `numbers` in a column. The `numbers` of all columns follow as doubles. The `overview` of all
    columns follow as float32. A column is left out if its `overview` is not as long as the
    `overview` of the last column.
    """
    kept = list(columns)
    height = kept[-1].overview.size if kept else 0
    kept = [column for column in kept if column.overview.size == height]
    head = [HISTORY, chain, len(kept), height, 3 + len(ENERGIES)]
    head += [value for column in kept for value in column.numbers]
    data = [np.asarray(column.overview, dtype='<f4').tobytes() for column in kept]
    return b''.join([np.array(head, dtype='<f8').tobytes(), *data])


def pack_camera(chain: int, stamp: float, age: float, jpeg: bytes) -> bytes:
    """Return a message with a camera picture.

    The message begins with four doubles: kind, chain index, stamp [s] and age [s]. The JPEG bytes
    follow.
    """
    return np.array([CAMERA, chain, stamp, age], dtype='<f8').tobytes() + jpeg
