# SPDX-License-Identifier: Apache-2.0
"""Files of a bag are opened if they are files and lie in it; a pipe or device would never end."""

from __future__ import annotations

import mmap
import os
import stat
from pathlib import Path
from typing import BinaryIO


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
