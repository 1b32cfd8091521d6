# SPDX-License-Identifier: Apache-2.0
"""The bytes that a page is sent: described once, for what packs them and the script.

All are little-endian and begin with their kind, a double. After it a frame has `FIELDS` as
doubles, the number of elements of each of `ARRAYS` as doubles, and the arrays as floats of 32
bits, one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

Floats = NDArray[np.float32]

KINDS = (
    'frame',  # of a chain
    'history',  # what a chain showed before
    'camera',  # a picture of the camera at a chain
)
FRAME, HISTORY, CAMERA = map(float, range(len(KINDS)))

FIELDS = (
    'chain',  # number of the chain in the list of the status
    'version',  # of what the status says of the chain, its parameters among them
    'stamp',  # of joint_states [s]
    'age',  # of joint_states when the frame was packed [s], infinite where none came
    'state_age',  # of soliton_state [s]
    'state_stamp',  # of soliton_state, or of joint_states where there is none [s]
    'rotors',
    'first',  # rotor of the first of the angles
    'rotor',
    'position',
    'position_deviation',
    'velocity',
    'velocity_deviation',
    'width',
    'wall_charge',
    'walls',
    'motion',
    'status',
    'phase',
    'phase_rate',
    'phase_deviation',
    'completed',
    'leg',
    'cycle_rotor',
    'kinetic',  # energies [J]
    'elastic',
    'wall_energy',
    'wake_energy',
    'winding_before',
    'winding_beyond',
    'polarisation_before',
    'polarisation_beyond',
    'charge',
    'zero_mode_rotor',
    'first_toggled',
    'last_toggled',
    'first_turns',
    'last_turns',
    'misfit',
    'unseen',
    'goal',  # of the move that is under way [rotor spacings]
)
ENERGIES = ('kinetic', 'elastic', 'wall_energy', 'wake_energy')
"""Those of the fields that a page draws over time [J]."""
ARRAYS = (
    'overview',  # u of each rotor [m], or the least and the largest of each of equal groups
    'angles',  # phi of each rotor of the part that is shown [rad]; empty where it is too long
    'extensions',  # of the spring after each of these rotors [m]
    'mode',  # component of the zero mode of each of these rotors [1]
    'places',  # place [rotor spacings], deviation [m] and charge of each wall, in a row
)


class Column(NamedTuple):
    """A chain at an instant of the past."""

    numbers: tuple[float, ...]
    """Stamp and that of what follows [s], place of the wall [rotor spacings], and `ENERGIES`."""
    overview: Floats


def pack(numbers: Mapping[str, float], arrays: Mapping[str, Array | Floats]) -> bytes:
    """Bytes of a frame; fields that are not given are NaN, and arrays empty.

    What is beyond the range of floats is infinite.
    """
    nothing = np.zeros(0, dtype='<f4')
    with np.errstate(over='ignore'):
        parts = [np.asarray(arrays.get(name, nothing), dtype='<f4') for name in ARRAYS]
    head = [FRAME, *(numbers.get(name, np.nan) for name in FIELDS)]
    head += [float(part.size) for part in parts]
    return b''.join([np.array(head, dtype='<f8').tobytes(), *(part.tobytes() for part in parts)])


def unpack(frame: bytes) -> tuple[dict[str, float], dict[str, Floats]]:
    """Fields and arrays of a frame."""
    head = np.frombuffer(frame, '<f8', 1 + len(FIELDS) + len(ARRAYS))
    begin = head.nbytes
    head = head[1:]
    numbers = dict(zip(FIELDS, head.tolist(), strict=False))
    arrays: dict[str, Floats] = {}
    for name, count in zip(ARRAYS, head[len(FIELDS) :], strict=True):
        arrays[name] = np.frombuffer(frame, '<f4', int(count), begin)
        begin += 4 * int(count)
    return numbers, arrays


def pack_history(chain: int, columns: Iterable[Column]) -> bytes:
    """Bytes of what a chain of a number in the list showed before, a column an instant.

    Doubles: kind, number of the chain, how many columns there are, of how many values each, and of
    how many numbers; of each column these numbers; then floats of 32 bits, one column after the
    other.
    """
    kept = list(columns)
    height = kept[-1].overview.size if kept else 0
    kept = [column for column in kept if column.overview.size == height]
    head = [HISTORY, chain, len(kept), height, 3 + len(ENERGIES)]
    head += [value for column in kept for value in column.numbers]
    data = [np.asarray(column.overview, dtype='<f4').tobytes() for column in kept]
    return b''.join([np.array(head, dtype='<f8').tobytes(), *data])


def pack_camera(chain: int, stamp: float, age: float, jpeg: bytes) -> bytes:
    """Bytes of a picture of the camera at a chain of a number in the list.

    Doubles: kind, number of the chain, stamp [s] and age [s]; then the JPEG.
    """
    return np.array([CAMERA, chain, stamp, age], dtype='<f8').tobytes() + jpeg


def kind_of(sent: bytes) -> str:
    """What a browser is sent, one of `KINDS`."""
    return KINDS[int(np.frombuffer(sent, '<f8', 1)[0])]
