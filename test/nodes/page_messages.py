# SPDX-License-Identifier: Apache-2.0
"""Reading of the binary messages to the page."""

import numpy as np

from soliton_linkage_nodes.live_view.frame_layout import ARRAYS, FIELDS, KINDS


def unpack(frame: bytes) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Return the fields and the arrays of a packed frame."""
    head = np.frombuffer(frame, '<f8', 1 + len(FIELDS) + len(ARRAYS))
    begin = head.nbytes
    numbers = dict(zip(FIELDS, head[1:].tolist(), strict=False))
    arrays: dict[str, np.ndarray] = {}
    for name, count in zip(ARRAYS, head[1 + len(FIELDS) :], strict=True):
        arrays[name] = np.frombuffer(frame, '<f4', int(count), begin)
        begin += 4 * int(count)
    return numbers, arrays


def kind_of(message: bytes) -> str:
    """Return the kind of a message, one of `KINDS`."""
    return KINDS[int(np.frombuffer(message, '<f8', 1)[0])]
