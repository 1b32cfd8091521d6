# SPDX-License-Identifier: Apache-2.0
"""All installed packages are pinned, and archives do not depend on time and place."""

import io
import runpy
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SETUP = Path(__file__).parents[1] / 'setup'


def test_every_requirement_has_a_pin():
    problems: Callable[[Path], list[str]] = runpy.run_path(str(SETUP / 'pins.py'))['problems']
    assert problems(SETUP) == []


def test_a_requirement_without_a_pin_is_named(tmp_path):
    problems: Callable[[Path], list[str]] = runpy.run_path(str(SETUP / 'pins.py'))['problems']
    (tmp_path / 'constraints.txt').write_text('numpy==2.2.6\nscipy>=1.11\n', encoding='utf-8')
    (tmp_path / 'requirements-run.txt').write_text(
        '# dependencies\nNumPy\nlz4  # packed bags\n', encoding='utf-8'
    )
    assert problems(tmp_path) == [
        "constraints.txt: 'scipy>=1.11' is no pin",
        'requirements-run.txt: lz4 has no pin in constraints.txt',
    ]


def packed(names: list[str], time: int, mode: int, user: str) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode='w:gz') as archive:
        for name in names:
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.mode, member.uname = len(name), time, mode, user
            archive.addfile(member, io.BytesIO(name.encode()))
    return stream.getvalue()


def zipped(names: list[str], year: int, mode: int) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, 'w') as archive:
        for name in names:
            member = zipfile.ZipInfo(name, (year, 1, 1, 0, 0, 0))
            member.external_attr = mode << 16
            archive.writestr(member, name)
    return stream.getvalue()


@pytest.mark.parametrize('kind', ['repacked', 'rezipped'])
def test_an_archive_does_not_depend_on_its_time_and_author(kind):
    again: Any = runpy.run_path(str(SETUP / 'release.py'))[kind]
    if kind == 'repacked':
        first, second = packed(['a', 'b'], 5, 0o644, 'me'), packed(['b', 'a'], 7, 0o600, 'you')
    else:
        first, second = zipped(['a', 'b'], 1999, 0o644), zipped(['b', 'a'], 2001, 0o600)
    assert first != second
    assert again(first, 1_700_000_000) == again(second, 1_700_000_000)
