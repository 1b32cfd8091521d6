# SPDX-License-Identifier: Apache-2.0
"""A cache of compiled loops that is damaged or cannot be written costs time, never a result."""

import os
import subprocess
import sys
from itertools import cycle
from pathlib import Path

import pytest

PARTS = """
from soliton_linkage.compiling import compile_loop

FACTOR = {factor}

@compile_loop
def scaled(x):
    return FACTOR * x
"""
LOOPS = '''
from parts import scaled
from soliton_linkage.compiling import compile_loop, compiled, f8

@compiled(f8)
def eager(x):
    """Return it."""
    return scaled(x) + 1.0

@compile_loop
def lazy(x):
    """Return it."""
    return scaled(x) + x
'''
RUN = 'import loops; print(loops.eager(2.0), loops.lazy(3), loops.lazy(0.5))'


class Loops:
    """A module with compiled loops, run by processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache = folder / 'cache'
        self.write(factor=10)
        (folder / 'loops.py').write_text(LOOPS, encoding='utf-8')

    def write(self, factor: int) -> None:
        (self.folder / 'parts.py').write_text(PARTS.format(factor=factor), encoding='utf-8')

    def start(self, run: str = RUN, **variables: str) -> subprocess.Popen[str]:
        environment = {
            **os.environ,
            'NUMBA_CACHE_DIR': str(self.cache),
            'PYTHONDONTWRITEBYTECODE': '1',
            'PYTHONPATH': os.pathsep.join([str(self.folder), *sys.path]),
            **variables,
        }
        return subprocess.Popen(
            [sys.executable, '-c', run],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, run: str = RUN, **variables: str) -> tuple[str, list[str]]:
        """Return what a process prints, and its warnings; it must not fail."""
        process = self.start(run, **variables)
        printed, warnings = process.communicate()
        assert process.returncode == 0, warnings
        return printed.strip(), warnings.splitlines()

    def files(self) -> dict[Path, tuple[int, int]]:
        """Return the files of the cache with their inode and size."""
        paths = (path for path in self.cache.rglob('*') if path.is_file())
        return {path: (path.stat().st_ino, path.stat().st_size) for path in paths}


RIGHT = '21.0 33 5.5'


@pytest.fixture
def loops(tmp_path):
    return Loops(tmp_path)


@pytest.fixture(scope='module')
def warm(tmp_path_factory):
    """Loops in a complete cache, which each test leaves complete."""
    loops = Loops(tmp_path_factory.mktemp('warm'))
    assert loops.run() == (RIGHT, [])
    return loops


def emptied(content: bytes) -> bytes:
    return b''


def truncated(content: bytes) -> bytes:
    return content[: len(content) // 2]


def with_a_wrong_byte(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def test_damaged_files_are_compiled_again_and_one_line_reports_it(warm):
    files = sorted(warm.files())
    assert len(files) >= 3
    for path, damage in zip(files, cycle((emptied, truncated, with_a_wrong_byte)), strict=False):
        path.write_bytes(damage(path.read_bytes()))
    result, warnings = warm.run()
    assert result == RIGHT
    assert len(warnings) == 1
    assert 'damaged' in warnings[0]
    assert warm.run() == (RIGHT, [])


def test_each_processor_has_its_own_files(warm):
    files = warm.files()
    assert warm.run(NUMBA_CPU_NAME='generic') == (RIGHT, [])
    assert warm.files().items() > files.items()


def test_files_of_another_numba_are_replaced(warm):
    other = warm.run(f'import numba; numba.__version__ = "0.1"; {RUN}')
    assert other == (RIGHT, [])
    assert warm.run() == (RIGHT, [])


RECORD = """
from typing import NamedTuple
from soliton_linkage.compiling import compile_loop

class Pair(NamedTuple):
    {0}: float
    {1}: float

@compile_loop
def first(x):
    return Pair(x, 2.0 * x).a
"""


def test_changes_of_a_loop_and_of_a_named_tuple_in_another_module_compile_the_caller_again(warm):
    for factor, fields, result in (
        (20, ('a', 'b'), '41.0 63 10.5\n1.0'),
        (10, ('b', 'a'), f'{RIGHT}\n2.0'),
    ):
        warm.write(factor)
        (warm.folder / 'pairs.py').write_text(RECORD.format(*fields), encoding='utf-8')
        assert warm.run(f'{RUN}; import pairs; print(pairs.first(1.0))') == (result, [])


def test_a_called_function_that_moves_to_another_module_compiles_the_caller_again(loops):
    assert loops.run() == (RIGHT, [])
    (loops.folder / 'parts.py').rename(loops.folder / 'pieces.py')
    moved = LOOPS.replace('parts', 'pieces')
    (loops.folder / 'loops.py').write_text(moved, encoding='utf-8')
    assert loops.run() == (RIGHT, [])


def test_a_second_process_compiles_nothing_even_with_other_comments_and_docstrings(warm):
    files = warm.files()
    assert files
    described = LOOPS.replace('Return it', 'Return a number')
    (warm.folder / 'loops.py').write_text(f'# A comment.\n{described}', encoding='utf-8')
    assert warm.run() == (RIGHT, [])
    assert warm.files() == files


def test_processes_that_write_at_once_do_not_disturb_each_other(loops):
    orders = ('loops.lazy(3), loops.lazy(0.5)', 'loops.lazy(0.5), loops.lazy(3)')
    processes = [loops.start(f'import loops; print({order})') for order in orders]
    results = [process.communicate() for process in processes]
    assert results == [('33 5.5\n', ''), ('5.5 33\n', '')]
    assert loops.run() == (RIGHT, [])


def test_without_a_folder_that_can_be_written_loops_are_compiled_at_each_start(loops):
    (loops.folder / '__pycache__').write_text('a file, so that no folder can be made')
    nowhere = {
        'NUMBA_CACHE_DIR': '/proc/none',
        'HOME': '/proc/none',
        'XDG_CACHE_HOME': '/proc/none',
    }
    result, warnings = loops.run(PYTHONDONTWRITEBYTECODE='1', **nowhere)
    assert result == RIGHT
    assert len(warnings) == 1
    assert 'NUMBA_CACHE_DIR' in warnings[0]


def test_a_folder_that_becomes_unwritable_stops_no_program(loops):
    late = 'import shutil, loops; shutil.rmtree(r"{0}"); open(r"{0}", "w").close(); '
    result, warnings = loops.run(
        late.format(loops.cache) + 'print(loops.eager(2.0), loops.lazy(3), loops.lazy(0.5))'
    )
    assert result == RIGHT
    assert len(warnings) == 1
    assert 'cannot be saved' in warnings[0]
