# SPDX-License-Identifier: Apache-2.0
"""Size limits for files, compressed data and texts from untrusted sources."""

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
"""Size of 1 MiB [B]."""
_LARGEST_RATIO = 25
"""Ratio of decompressed to compressed size that is accepted for every file [1]. A file with a
larger ratio is accepted if its decompressed size is at most `BagLimits.max_unpacked_file`. Bags
of a chain at rest compress best, because the angles are constant. Their ratio is 10."""


@dataclass(frozen=True)
class BagLimits:
    """Size limits. Readers reject a bag that exceeds a limit. Recovery omits the excess data."""

    max_unpacked: int = quantity(
        64 * _MEBIBYTE, 'largest decompressed size of a message or chunk', 'B', 1024, 2**31
    )
    max_unpacked_file: int = quantity(
        512 * _MEBIBYTE,
        'largest decompressed size of one file of a bag, or 25 times its size if that is more',
        'B',
        1024,
        2**40,
    )

    def for_file(self, size: int) -> int:
        """Return the largest accepted decompressed size of a file with `size` bytes [B]."""
        return max(self.max_unpacked_file, _LARGEST_RATIO * size)


DEFAULT_LIMITS = BagLimits()
PACKED = '.zstd'


def decompress_file(packed: Path, folder: str, limits: BagLimits) -> tuple[Path, str | None]:
    """Decompress a zstd file into a folder, up to the first damage or up to the size limit.

    The first result is the path of the new file. The second result is the reason why the new file
    is incomplete, or None.
    """
    plain, data = Path(folder, packed.stem), map_file(packed)
    most = limits.for_file(len(data))
    with plain.open('wb') as out:
        try:
            for block in decompressed_blocks(data, 'zstd', whole=True):
                if out.tell() + len(block) > most:
                    limit = f'max_unpacked_file = {most} bytes'
                    return plain, f'its content exceeds {limit}: truncated there'
                out.write(block)
        except ValueError as error:
            return plain, str(error)
    return plain, None


ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_BLOCK_IN = 4096
"""Size of the data that a decompressor receives in one call [B]. It is small, because one damaged
byte causes the loss of the whole output of the call."""
_BLOCK_OUT = 2**20
"""Largest number of bytes that a decompressor returns in one call [B]."""


def decompressed_blocks(
    packed: bytes | bytearray | memoryview, codec: str, whole: bool = False
) -> Iterator[bytes]:
    """Yield the content of zstd or lz4 data in blocks.

    Raises ValueError if the data is damaged. If `whole` is set, truncated data is also an error.
    """
    packed = memoryview(packed)
    begin, decompressor, at_end = 0, _decompressor(codec), False
    while begin < len(packed):
        given: bytes | memoryview = packed[begin : begin + _BLOCK_IN]
        begin += len(given)
        try:
            while given or not (decompressor.needs_input or decompressor.eof):
                if block := decompressor.decompress(given, _BLOCK_OUT):
                    yield block
                given = b''
            at_end = decompressor.eof
            if at_end:
                # Another compressed frame may follow.
                begin -= len(decompressor.unused_data or b'')
                decompressor = _decompressor(codec)
        except (zstd.ZstdError, RuntimeError, EOFError) as error:
            raise ValueError(f'its compressed data is damaged: {error}') from error
    if whole and not at_end:
        raise ValueError('its compressed data is truncated')


def decompress_prefix(packed: bytes | bytearray | memoryview, codec: str, most: int) -> bytearray:
    """Return the decompressed data up to the first damage, but at most `most` + 1 bytes.

    A result of `most` + 1 bytes shows that the data exceeds `most` bytes.
    """
    out = bytearray()
    try:
        for block in decompressed_blocks(packed, codec):
            out += block
            if len(out) > most:
                del out[most + 1 :]
                break
    except ValueError:
        pass
    return out


def decompressed_message(data: bytes, most: int) -> bytes:
    """Return the bytes of a message, after decompression if they are compressed.

    Raises ValueError if the compressed data is damaged or if its content exceeds `most` bytes.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    out = bytearray()
    for block in decompressed_blocks(data, 'zstd', whole=True):
        out += block
        if len(out) > most:
            raise ValueError(f'a decompressed message exceeds max_unpacked = {most} bytes')
    return bytes(out)


def _decompressor(codec: str) -> Any:
    return zstd.ZstdDecompressor() if codec == 'zstd' else lz4.frame.LZ4FrameDecompressor()


def regular_file(path: Path, folder: Path | None = None) -> Path:
    """Return the path with all links resolved.

    Raises ValueError if the path is not a regular file or is outside of `folder`.
    """
    resolved = path.resolve(strict=True)
    if folder is not None and not resolved.is_relative_to(folder.resolve()):
        raise ValueError(
            f'{str(path)!r} links to {str(resolved)!r} outside its bag; copy the file into the bag'
        )
    mode = resolved.stat().st_mode
    if not stat.S_ISREG(mode):
        kinds = {stat.S_ISFIFO: 'a pipe', stat.S_ISDIR: 'a folder', stat.S_ISSOCK: 'a socket'}
        kind = next((name for is_kind, name in kinds.items() if is_kind(mode)), 'a device')
        raise ValueError(f'{str(path)!r} is {kind}, not a file; remove it')
    return resolved


def open_file(path: Path, folder: Path | None = None) -> BinaryIO:
    """Open a regular file for reading. Raises the same errors as `regular_file`."""
    resolved = regular_file(path, folder)
    # The file may have been replaced after the check. With these flags the call neither blocks on
    # a pipe nor follows a link.
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
    file = os.fdopen(os.open(resolved, flags), 'rb')
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise ValueError(f'{str(path)!r} was replaced while it was opened; try again')
    return file


def read_file(path: Path, folder: Path | None, most: int) -> bytes:
    """Return the content of a regular file. Raises ValueError if the file exceeds `most` bytes."""
    with open_file(path, folder) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f'{str(path)!r} exceeds {most} bytes')
    return content


def map_file(path: Path) -> memoryview:
    """Map a regular file into memory, and return its content."""
    with open_file(path) as file:
        if not file.seek(0, 2):
            return memoryview(b'')
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


def release_pages(data: memoryview | mmap.mmap) -> None:
    """Release the memory of a mapped file. On the next access the system reads the file again."""
    whole = data.obj if isinstance(data, memoryview) else data
    if isinstance(whole, mmap.mmap):
        whole.madvise(mmap.MADV_DONTNEED)


MAX_TEXT_SIZE = 4 * 2**20
"""Longest text that is parsed [characters]. A parser needs 100 times the memory of its text."""
_DEEPEST = 30
"""Largest accepted nesting depth of lists and mappings [1]. Files of rosbag2 have 6 levels."""
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_OPENING = (yaml.SequenceStartEvent, yaml.MappingStartEvent)
_CLOSING = (yaml.SequenceEndEvent, yaml.MappingEndEvent)
_LONG_NUMBER = re.compile(r'[-+]?\d[\d_:.]{99,}')
"""Pattern of numbers with 100 or more characters. They are rejected, because their conversion may
be slow."""


def load_yaml(text: str) -> Any:
    """Parse a YAML text.

    Raises ValueError if the text is invalid, too long or nested too deeply, or if it contains
    aliases or long numbers.
    """
    _check_size(text)
    try:
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
            if depth > _DEEPEST:
                raise ValueError(f'it is nested deeper than {_DEEPEST} levels')
            if isinstance(event, yaml.AliasEvent):
                raise ValueError('it contains an alias; aliases are not read')
            plain = isinstance(event, yaml.ScalarEvent) and not event.style
            if plain and _LONG_NUMBER.fullmatch(event.value):
                raise ValueError(f'it contains a number of {len(event.value)} characters')
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, RecursionError, OverflowError) as error:
        raise ValueError(' '.join(str(error).split())) from error


def load_json(text: str) -> Any:
    """Parse a JSON text. Raises ValueError if it is invalid, too long or nested too deeply."""
    _check_size(text)
    try:
        return json.loads(text, parse_constant=_reject_constant)
    except RecursionError as error:
        raise ValueError('it is nested too deeply') from error


def parse_count(value: object) -> int:
    """Return a count from a value in an untrusted file: an integer, or a text of digits.

    Returns 0 for any other value, for integers outside the range from 0 to 2^63 - 1, and for texts
    of more than 18 digits.
    """
    number = int(value) if isinstance(value, str) and re.fullmatch(r'\d{1,18}', value) else value
    valid = isinstance(number, int) and not isinstance(number, bool) and 0 <= number < 2**63
    return number if valid and isinstance(number, int) else 0


def _check_size(text: str) -> None:
    if len(text) > MAX_TEXT_SIZE:
        raise ValueError(f'it has {len(text)} characters, more than {MAX_TEXT_SIZE}')


def _reject_constant(name: str) -> Any:
    raise ValueError(f'{name} is not a JSON number')
