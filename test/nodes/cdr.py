# SPDX-License-Identifier: Apache-2.0
"""CDR as it is defined, written one value after the other."""

import struct
from typing import Any

_NUMBERS = {
    'double': 'd', 'int32': 'i', 'uint32': 'I', 'int8': 'b', 'uint8': 'B', 'boolean': '?',
}  # fmt: skip


class CdrWriter:
    """Bytes of a message, and which of them mean something: between values there can be any."""

    def __init__(self, message: Any) -> None:
        self._body = bytearray()
        self.meant = bytearray()
        self._message(message)

    @property
    def serialized(self) -> bytes:
        """The message with zeros between its values."""
        return b'\x00\x01\x00\x00' + bytes(self._body)

    def same(self, serialized: bytes) -> bool:
        """Whether bytes are the message; more of them may follow at the end."""
        body = serialized[4 : 4 + len(self._body)]
        differ = [one != other for one, other in zip(body, self._body, strict=True)]
        head = serialized[:4] == self.serialized[:4]
        return head and not any(map(int.__and__, differ, self.meant))

    def _message(self, message: Any) -> None:
        for name, kind in message.get_fields_and_field_types().items():
            self._value(kind, getattr(message, name))

    def _value(self, kind: str, value: Any) -> None:
        if kind.startswith('sequence<'):
            self._number('I', len(value))
            for element in value:
                self._value(kind[len('sequence<') : -1], element)
        elif kind == 'string':
            text = value.encode() + b'\x00'
            self._number('I', len(text))
            self._write(text)
        elif kind in _NUMBERS:
            self._number(_NUMBERS[kind], value)
        else:
            self._message(value)

    def _number(self, code: str, value: float) -> None:
        number = struct.pack(f'<{code}', value)
        gap = -len(self._body) % len(number)
        self._body += bytes(gap)
        self.meant += bytes(gap)
        self._write(number)

    def _write(self, part: bytes) -> None:
        self._body += part
        self.meant += b'\x01' * len(part)
