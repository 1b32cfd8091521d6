# SPDX-License-Identifier: Apache-2.0
"""Impulses as the simulator takes them, from their CDR bytes without a message of each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rclpy.serialization import deserialize_message

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages.conversions import impulses_from_msg
from soliton_linkage_nodes.messages.named_arrays import Layout


class ImpulseDecoder:
    """Decodes rotor_impulses, fast where frame and names are those of the message before."""

    def __init__(self, rotors: Mapping[str, int], largest: float) -> None:
        """Number of each rotor by its name, and the largest impulse accepted [N m s]."""
        self._rotors = rotors
        self._largest = largest
        self._layout: Layout | None = None
        self._order = np.zeros(0, dtype=np.intp)

    def decode(self, serialized: bytes) -> Array:
        """Impulse of each rotor [N m s], shape (N,); ValueError unless all are acceptable."""
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                (given,) = layout.arrays(serialized, 1)
                if len(given) == len(self._order) and (np.abs(given) <= self._largest).all():
                    impulses = np.zeros(len(self._rotors))
                    impulses[self._order] = given
                    return impulses
            message = deserialize_message(serialized, RotorImpulses)
        except Exception as error:  # rclpy's own has no public name
            raise ValueError(
                f'rotor_impulses of {len(serialized)} bytes are no RotorImpulses: {error}; mend '
                'what publishes them'
            ) from error
        impulses = impulses_from_msg(self._rotors, message, self._largest)
        self._layout = Layout(message.header.frame_id, tuple(message.name))
        self._order = np.array([self._rotors[name] for name in message.name], dtype=np.intp)
        return impulses
