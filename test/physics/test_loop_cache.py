# SPDX-License-Identifier: Apache-2.0
"""A cache of compiled loops that is damaged or cannot be written costs time, never a result."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PARTS = """
from soliton_linkage.compiling import compile_loop

FACTOR = {factor}

@compile_loop
def scaled(x):
    return FACTOR * x
"""
LOOPS = """
from parts import scaled
from soliton_linkage.compiling import compile_loop, compiled, f8

@compiled(f8)
def eager(x):
    return scaled(x) + 1.0

@compile_loop
def lazy(x):
    return scaled(x) + x
"""
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


def test_a_second_process_compiles_nothing(loops):
    assert loops.run() == (RIGHT, [])
    files = loops.files()
    assert files
    assert loops.run() == (RIGHT, [])
    assert loops.files() == files


def emptied(content: bytes) -> bytes:
    return b''


def truncated(content: bytes) -> bytes:
    return content[: len(content) // 2]


def with_a_wrong_byte(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize('damage', [emptied, truncated, with_a_wrong_byte])
def test_damaged_files_are_compiled_again_and_one_line_reports_it(loops, damage):
    loops.run()
    for path in loops.files():
        path.write_bytes(damage(path.read_bytes()))
    result, warnings = loops.run()
    assert result == RIGHT
    assert len(warnings) == 1
    assert 'damaged' in warnings[0]
    assert loops.run() == (RIGHT, [])


def test_each_processor_has_its_own_files(loops):
    loops.run()
    files = loops.files()
    assert loops.run(NUMBA_CPU_NAME='generic') == (RIGHT, [])
    assert loops.files().items() > files.items()


def test_files_of_another_numba_are_replaced(loops):
    loops.run()
    other = loops.run(f'import numba; numba.__version__ = "0.1"; {RUN}')
    assert other == (RIGHT, [])
    assert loops.run() == (RIGHT, [])


def test_a_change_of_a_called_loop_in_another_module_compiles_the_caller_again(loops):
    loops.run()
    loops.write(factor=20)
    assert loops.run() == ('41.0 63 10.5', [])


def test_comments_docstrings_and_line_numbers_compile_nothing_again(loops):
    described = LOOPS.replace('return', '"""Return it."""\n    return')
    (loops.folder / 'loops.py').write_text(described, encoding='utf-8')
    loops.run()
    files = loops.files()
    described = '# A comment.\n' + described.replace('Return it', 'Return a number')
    (loops.folder / 'loops.py').write_text(described, encoding='utf-8')
    assert loops.run() == (RIGHT, [])
    assert loops.files() == files


def test_a_change_of_the_fields_of_a_named_tuple_compiles_again(loops):
    record = """
from typing import NamedTuple
from soliton_linkage.compiling import compile_loop

class Pair(NamedTuple):
    {0}: float
    {1}: float

@compile_loop
def first(x):
    return Pair(x, 2.0 * x).a
"""
    printed = []
    for fields in (('a', 'b'), ('b', 'a')):
        (loops.folder / 'pairs.py').write_text(record.format(*fields), encoding='utf-8')
        printed.append(loops.run('import pairs; print(pairs.first(1.0))'))
    assert printed == [('1.0', []), ('2.0', [])]


def test_processes_that_write_at_once_do_not_disturb_each_other(loops):
    orders = ('loops.lazy(3), loops.lazy(0.5)', 'loops.lazy(0.5), loops.lazy(3)')
    processes = [loops.start(f'import loops; print({order})') for order in 2 * orders]
    results = [process.communicate() for process in processes]
    assert results == 2 * [('33 5.5\n', ''), ('5.5 33\n', '')]
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
