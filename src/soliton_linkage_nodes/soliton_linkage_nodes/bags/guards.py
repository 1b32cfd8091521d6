# SPDX-License-Identifier: Apache-2.0
"""Limits within which files, packed data and texts that others wrote are read."""

from __future__ import annotations

import json
import mmap
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import yaml
from backports import zstd

from soliton_linkage.linkage.quantities import quantity

_MEBIBYTE = 2**20
"""Bytes in 1 MiB."""
_LARGEST_RATIO = 25
"""Times that a large file may unpack to: joint states of a machine at rest shrink to a tenth."""


@dataclass(frozen=True)
class BagLimits:
    """What a bag is read with; what asks for more is left out or refused, by the limit's name."""

    most_unpacked: int = quantity(
        64 * _MEBIBYTE,
        'size that one message or chunk of a bag may have, unpacked',
        'B',
        1024,
        2**31,
    )
    most_unpacked_file: int = quantity(
        512 * _MEBIBYTE,
        'size that one file of a bag may have, unpacked, or 25 times its size if that is more',
        'B',
        1024,
        2**40,
    )

    def for_file(self, size: int) -> int:
        """What a file of a size [B] may unpack to in all [B]."""
        return max(self.most_unpacked_file, _LARGEST_RATIO * size)


DEFAULT_LIMITS = BagLimits()


PACKED = '.zstd'


def unpack_file(packed: BinaryIO, plain: Path, limits: BagLimits) -> str | None:
    """Unpack a file as far as it can be; return what is wrong with it."""
    size = packed.seek(0, 2)
    most = limits.for_file(size)
    if not size:
        return 'its compression is cut short'
    with (
        mmap.mmap(packed.fileno(), 0, access=mmap.ACCESS_READ) as data,
        memoryview(data) as view,
        plain.open('wb') as out,
    ):
        try:
            for piece in pieces(view, 'zstd', whole=True):
                if out.tell() + len(piece) > most:
                    return f'it unpacks to more than most_unpacked_file = {most} bytes: cut there'
                out.write(piece)
        except ValueError as error:
            return str(error)
    return None


ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_PIECE_IN = 4096
"""Size of what is given to an unpacker [B]: what is before damage comes out, to the last piece."""
_PIECE_OUT = 2**20
"""Size of what it may answer at one go [B]."""


def pieces(
    packed: bytes | bytearray | memoryview, codec: str, whole: bool = False
) -> Iterator[bytes]:
    """Yield what comes out of zstd or lz4; ends with the data, ValueError where they are damaged.

    No more is kept than one piece; who takes them stops at a limit. Data that must be `whole` end
    with a frame.
    """
    packed = memoryview(packed)
    begin, unpacker, at_end = 0, _unpacker(codec), False
    while begin < len(packed):
        given: bytes | memoryview = packed[begin : begin + _PIECE_IN]
        begin += len(given)
        try:
            while given or not (unpacker.needs_input or unpacker.eof):
                if piece := unpacker.decompress(given, _PIECE_OUT):
                    yield piece
                given = b''
            at_end = unpacker.eof
            if at_end:
                # Frames may follow each other.
                begin -= len(unpacker.unused_data or b'')
                unpacker = _unpacker(codec)
        except (zstd.ZstdError, RuntimeError, EOFError) as error:
            raise ValueError(f'its compression is damaged: {error}') from error
    if whole and not at_end:
        raise ValueError('its compression is cut short')


def unpacked_begin(packed: bytes | bytearray | memoryview, codec: str, most: int) -> bytearray:
    """What comes out before damage, the end or the limit [B], of which there is one byte more."""
    out = bytearray()
    try:
        for piece in pieces(packed, codec):
            out += piece
            if len(out) > most:
                del out[most + 1 :]
                break
    except ValueError:
        pass
    return out


def unpacked_message(data: bytes, most: int) -> bytes:
    """A message that may be packed with zstd by itself; ValueError where that is damaged."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    out = bytearray()
    for piece in pieces(data, 'zstd', whole=True):
        out += piece
        if len(out) > most:
            raise ValueError(f'a message unpacks to more than most_unpacked = {most} bytes')
    return bytes(out)


def _unpacker(codec: str) -> Any:
    return zstd.ZstdDecompressor() if codec == 'zstd' else lz4.frame.LZ4FrameDecompressor()


def regular_file(path: Path, folder: Path | None = None) -> Path:
    """Path of a regular file, links followed, which lies in the folder where one is given.

    Raises ValueError where it does not or is something else, OSError where it cannot be asked.
    """
    resolved = path.resolve(strict=True)
    if folder is not None and not resolved.is_relative_to(folder.resolve()):
        raise ValueError(
            f'{str(path)!r} is a link to {str(resolved)!r}, out of its bag; copy that here'
        )
    mode = resolved.stat().st_mode
    if not stat.S_ISREG(mode):
        raise ValueError(f'{str(path)!r} is no file but {_kind(mode)}; remove it')
    return resolved


def open_file(path: Path, folder: Path | None = None) -> BinaryIO:
    """Open a regular file to read; raises what `regular_file` raises."""
    resolved = regular_file(path, folder)
    # What is put there since is not waited for, nor followed.
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
    file = os.fdopen(os.open(resolved, flags), 'rb')
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise ValueError(f'{str(path)!r} has become something else than a file; try again')
    return file


def read_file(path: Path, folder: Path | None, most: int) -> bytes:
    """Content of a regular file; ValueError where it has more than so many bytes."""
    with open_file(path, folder) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f'{str(path)!r} has more than {most} bytes')
    return content


def mapped(path: Path) -> memoryview:
    """Content of a regular file, of which memory holds what is looked at."""
    with open_file(path) as file:
        if not file.seek(0, 2):
            return memoryview(b'')
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


def forget(data: memoryview | mmap.mmap) -> None:
    """Let go of the memory that holds what was looked at of a file."""
    whole = data.obj if isinstance(data, memoryview) else data
    if isinstance(whole, mmap.mmap):
        whole.madvise(mmap.MADV_DONTNEED)


def _kind(mode: int) -> str:
    kinds = {stat.S_ISFIFO: 'a pipe', stat.S_ISDIR: 'a folder', stat.S_ISSOCK: 'a socket'}
    return next((name for is_kind, name in kinds.items() if is_kind(mode)), 'a device')


LARGEST_TEXT = 4 * 2**20
"""Size of a text that is taken [B]: metadata.yaml of a thousand topics has a fourth of it, and
what is made of a text takes a hundred times its size."""
_DEEPEST = 30
"""Levels of lists and mappings; what rosbag2 writes has 6."""
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_OPENING = (yaml.SequenceStartEvent, yaml.MappingStartEvent)
_CLOSING = (yaml.SequenceEndEvent, yaml.MappingEndEvent)
_LONG_NUMBER = re.compile(r'[-+]?\d[\d_:.]{99,}')
"""A number whose value takes longer to work out than all the text."""
_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]', re.DOTALL)


def load_yaml(text: str) -> Any:
    """What a text says in plain YAML; ValueError where it is none, too large or too deep.

    Aliases, by which a few lines stand for billions, and tags of Python objects are refused.
    """
    _check_size(text)
    try:
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
            _check_depth(depth)
            if isinstance(event, yaml.AliasEvent):
                raise ValueError('it has an alias, which stands for another part of it')
            plain = isinstance(event, yaml.ScalarEvent) and not event.style
            if plain and _LONG_NUMBER.fullmatch(event.value):
                raise ValueError(f'it has a number of {len(event.value)} characters')
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, RecursionError, OverflowError) as error:
        raise ValueError(' '.join(str(error).split())) from error


def load_json(text: str) -> Any:
    """What a text says in JSON; ValueError where it is none, too large or too deep."""
    _check_size(text)
    depth = 0
    for token in _JSON_TOKEN.finditer(text):
        depth += {'[': 1, '{': 1, ']': -1, '}': -1}.get(token[0], 0)
        _check_depth(depth)
    return json.loads(text, parse_constant=_refuse_constant)


def count_in(value: object) -> int:
    """A count as it may stand in a text, 0 for what is none."""
    number = int(value) if isinstance(value, str) and re.fullmatch(r'\d{1,18}', value) else value
    sound = isinstance(number, int) and not isinstance(number, bool) and 0 <= number < 2**63
    return number if sound and isinstance(number, int) else 0


def _check_size(text: str) -> None:
    if len(text) > LARGEST_TEXT:
        raise ValueError(f'it has {len(text)} characters, more than {LARGEST_TEXT}')


def _check_depth(depth: int) -> None:
    if depth > _DEEPEST:
        raise ValueError(f'it is nested deeper than {_DEEPEST} levels')


def _refuse_constant(name: str) -> Any:
    raise ValueError(f'{name} is no number of JSON')
