# SPDX-License-Identifier: Apache-2.0
"""Bytes of a serial line in pieces of any size to frames, in whichever protocol they are."""

from __future__ import annotations

from enum import Enum

from soliton_linkage.microcontroller.binary_frames import END, decode_binary, encode_binary
from soliton_linkage.microcontroller.frames import SerialFrame
from soliton_linkage.microcontroller.text_frames import (
    END_OF_LINE,
    decode_text,
    encode_text,
    is_remark,
)

LONGEST_FRAME = 2**16
"""Bytes that wait for an end [1]: 2500 rotors in text, and more than any other noise is worth."""


class Protocol(Enum):
    """How frames are written."""

    TEXT = 'text'
    BINARY = 'binary'


def encode(frame: SerialFrame, protocol: Protocol) -> bytes:
    """Bytes of a frame."""
    return encode_binary(frame) if protocol is Protocol.BINARY else encode_text(frame)


class FrameDecoder:
    """Takes what comes on a line, and gives the frames in it, however it was cut.

    The protocol is the one of the last frame that was understood. What came before the first is
    the rest of a frame, or of another program. Once a line of text has had a checksum, all must.
    """

    def __init__(self) -> None:
        self.protocol: Protocol | None = None
        """Which it is, None before the first frame."""
        self.frames = 0
        """Frames that were understood."""
        self.corrupted = 0
        """Frames of the protocol that were not."""
        self.complaint = ''
        """What was wrong with the last of these."""
        self.begin_anew()

    def begin_anew(self) -> None:
        """Take what comes for that of another controller; the counts go on."""
        self.protocol = None
        self._checked = False
        self._lines, self._pieces = _Splitter(END_OF_LINE), _Splitter(END)

    def feed(self, chunk: bytes) -> list[SerialFrame]:
        """Frames that end in a chunk, in their order."""
        ended = [(end, Protocol.TEXT, line) for end, line in self._lines.feed(chunk)]
        ended += [(end, Protocol.BINARY, piece) for end, piece in self._pieces.feed(chunk)]
        ended.sort(key=lambda each: each[0])
        read = (self._understood(protocol, written) for _, protocol, written in ended)
        frames = [frame for frame in read if frame is not None]
        self.frames += len(frames)
        return frames

    def _understood(self, protocol: Protocol, written: bytes | None) -> SerialFrame | None:
        try:
            if written is None:
                raise ValueError(f'{LONGEST_FRAME} bytes come without an end of a frame')
            frame = self._text(written) if protocol is Protocol.TEXT else _binary(written)
        except ValueError as error:
            if protocol is self.protocol:
                self.corrupted += 1
                self.complaint = str(error)
            return None
        if frame is not None:
            self.protocol = protocol
        return frame

    def _text(self, line: bytes) -> SerialFrame | None:
        if is_remark(line):
            return None
        frame, checked = decode_text(line)
        if self._checked and not checked:
            raise ValueError('a line has no checksum, as those before it had')
        self._checked = checked
        return frame


def _binary(piece: bytes) -> SerialFrame | None:
    return decode_binary(piece) if piece else None


class _Splitter:
    """Cuts a stream at each end of a frame."""

    def __init__(self, end: bytes) -> None:
        self._end = end
        self._rest = b''
        self._begin = 0
        self._passing = False

    def feed(self, chunk: bytes) -> list[tuple[int, bytes | None]]:
        """What ends in a chunk, each with where it does; None for what is too long."""
        *whole, rest = (self._rest + chunk).split(self._end)
        found: list[tuple[int, bytes | None]] = []
        for piece in whole:
            self._take(piece, found)
            self._begin += len(piece) + 1
            self._passing = False
        self._rest = rest
        if self._passing or len(rest) > LONGEST_FRAME:
            self._take(rest, found)
            self._passing = True
            self._begin += len(rest)
            self._rest = b''
        return found

    def _take(self, piece: bytes, found: list[tuple[int, bytes | None]]) -> None:
        if self._passing:
            return
        if len(piece) > LONGEST_FRAME:
            found.append((self._begin + LONGEST_FRAME, None))
        else:
            found.append((self._begin + len(piece), piece))
