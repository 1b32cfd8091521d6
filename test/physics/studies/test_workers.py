# SPDX-License-Identifier: Apache-2.0
"""Processes are prepared, have one thread each, and end with the work or with their parent."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from soliton_linkage.studies.workers import interrupts_held, local_processes, process_count

THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
LONGEST_WAIT = 60.0
ORPHANING = """
import os, sys
from soliton_linkage.studies.workers import local_processes
if __name__ == '__main__':
    with local_processes(2) as executor:
        print(executor.submit(os.getpid).result(), flush=True)
        sys.stdin.read()
"""


def fail_while_one_works() -> None:
    with local_processes(2) as executor:
        executor.submit(time.sleep, 600)
        raise ZeroDivisionError('a test')


def has_ended(process: int) -> bool:
    """Whether a process runs no more; one that nobody waits for has ended as well."""
    try:
        state = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()[0]
    except OSError:
        return True
    return state == 'Z'


@pytest.mark.parametrize('text', ['1', '2', '1000'])
def test_a_number_of_processes_is_read(text: str) -> None:
    assert process_count(text) == int(text)


@pytest.mark.parametrize('text', ['0', '-1', '1001', '1.5', 'two', '', '²', '٣'])
def test_what_is_no_number_of_processes_is_refused(text: str) -> None:
    complaint = f'{text!r} must be a whole number from 1 to 1000'
    with pytest.raises(argparse.ArgumentTypeError, match=complaint):
        process_count(text)


def test_each_process_has_one_thread_and_this_one_as_many_as_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(THREADS[0], '7')
    monkeypatch.delenv(THREADS[1], raising=False)
    before = dict(os.environ)
    with local_processes(1) as executor:
        threads = [executor.submit(os.getenv, name).result() for name in THREADS]
    assert threads == ['1', '1', '1']
    assert dict(os.environ) == before


def test_a_process_is_prepared_before_it_works() -> None:
    with local_processes(1, os.umask, (0o123,)) as executor:
        assert executor.submit(os.umask, 0o123).result() == 0o123


def test_processes_end_at_once_where_the_work_fails_and_no_others_do() -> None:
    other = multiprocessing.get_context('spawn').Process(target=time.sleep, args=(600,))
    other.start()
    begun = time.monotonic()
    try:
        with pytest.raises(ZeroDivisionError, match='a test'):
            fail_while_one_works()
        assert time.monotonic() - begun < LONGEST_WAIT
        assert multiprocessing.active_children() == [other]
    finally:
        other.kill()
        other.join()


def test_processes_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / 'parent.py'
    script.write_text(ORPHANING, encoding='utf-8')
    with subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout
        child = int(parent.stdout.readline())
        assert not has_ended(child)
        parent.kill()
        deadline = time.monotonic() + LONGEST_WAIT
        while not has_ended(child):
            assert time.monotonic() < deadline, f'process {child} has outlived its parent'
            time.sleep(0.02)


def test_an_interrupt_that_is_held_comes_afterwards() -> None:
    reached = []

    def interrupted() -> None:
        with interrupts_held():
            signal.raise_signal(signal.SIGINT)
            reached.append('the end')

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert reached == ['the end']
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_held_interrupts_stay_held_where_they_were() -> None:
    with interrupts_held():
        with interrupts_held():
            pass
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
