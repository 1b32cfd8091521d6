# SPDX-License-Identifier: Apache-2.0
import math
import struct

import numpy as np
from page_messages import kind_of, unpack

from soliton_linkage_nodes.live_view.frame_layout import (
    ARRAYS,
    FIELDS,
    Column,
    pack,
    pack_history,
)


def test_unpacking_inverts_packing():
    numbers = {name: float(index) for index, name in enumerate(FIELDS)}
    arrays = {name: np.arange(index, dtype=np.float32) for index, name in enumerate(ARRAYS)}
    fields, unpacked = unpack(pack(numbers, arrays))
    assert fields == numbers
    assert set(unpacked) == set(ARRAYS)
    for name, values in arrays.items():
        np.testing.assert_array_equal(unpacked[name], values)


def test_missing_fields_are_nan_and_missing_arrays_are_empty():
    fields, unpacked = unpack(pack({'rotors': 3.0}, {}))
    assert fields['rotors'] == 3.0
    assert all(math.isnan(value) for name, value in fields.items() if name != 'rotors')
    assert not any(len(values) for values in unpacked.values())


def test_fields_are_little_endian_doubles_in_their_order():
    frame = pack({'stamp': 1.5}, {'angles': np.array([0.25])})
    index = 1 + FIELDS.index('stamp')
    assert struct.unpack_from('<d', frame, 8 * index) == (1.5,)
    counts = struct.unpack_from(f'<{len(ARRAYS)}d', frame, 8 * (1 + len(FIELDS)))
    assert counts == tuple(float(name == 'angles') for name in ARRAYS)
    assert struct.unpack('<f', frame[-4:]) == (0.25,)


def test_a_history_contains_its_chain_and_columns():
    column = np.array([1.0, 2.0], dtype=np.float32)
    numbers = ((10.0, 9.5, 0.5, 1.0, 2.0, 3.0, 4.0), (11.0, 10.5, math.nan, 5.0, 6.0, 7.0, 8.0))
    packed = pack_history(3, [Column(numbers[0], column), Column(numbers[1], 2 * column)])
    assert kind_of(packed) == 'history'
    head = struct.unpack_from('<18d', packed, 8)
    assert head[:13] == (3.0, 2.0, 2.0, 7.0, *numbers[0], 11.0, 10.5)
    assert math.isnan(head[13])
    assert head[14:] == numbers[1][3:]
    assert struct.unpack('<4f', packed[152:]) == (1.0, 2.0, 2.0, 4.0)


def test_a_history_omits_columns_of_another_length():
    columns = [Column((0.0,) * 7, np.zeros(n, dtype=np.float32)) for n in (5, 3)]
    assert struct.unpack_from('<3d', pack_history(0, columns), 8) == (0.0, 1.0, 3.0)
