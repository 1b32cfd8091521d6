# SPDX-License-Identifier: Apache-2.0
"""Processes are prepared, have one thread each, and end with the work or with their parent."""

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from pools import Here

from soliton_linkage_studies import workers as study_workers
from soliton_linkage_studies.sweep.config import Axis, SweepStudy
from soliton_linkage_studies.workers import (
    Processes,
    cluster,
    defer_interrupts,
    local_processes,
    measure_rows,
    process_count,
)

THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
LONGEST_WAIT = 240.0
ORPHANING = """
import os, sys
from soliton_linkage_studies.workers import local_processes
if __name__ == '__main__':
    with local_processes(2) as processes:
        processes.submit(os.getpid)
        print(next(processes.finished()).result(), flush=True)
        sys.stdin.read()
"""
MASKS = """
import signal
from soliton_linkage_studies.workers import local_processes
if __name__ == '__main__':
    with local_processes(2) as processes:
        for _ in range(2):
            processes.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ())
        print([signal.SIGINT in future.result() for future in processes.finished()])
"""
SENDING = """
from soliton_linkage_studies.workers import local_processes
if __name__ == '__main__':
    with local_processes(2) as processes:
        for _ in range(20):
            processes.submit(bytes, 200000)
        for number, _ in enumerate(processes.finished()):
            processes.submit(bytes, 200000)
            if number == 10:
                print('sending', flush=True)
"""


def fail_while_one_works() -> None:
    with local_processes(2) as processes:
        processes.submit(time.sleep, 3600)
        raise ZeroDivisionError('a test')


def result(processes: Processes, *task: Any) -> Any:
    future = processes.submit(*task)
    assert next(processes.finished()) is future
    return future.result()


def command_of(program: str, folder: Path) -> list[str]:
    script = folder / 'program.py'
    script.write_text(program, encoding='utf-8')
    return [sys.executable, str(script)]


def has_ended(process: int) -> bool:
    """Return whether a process has ended; a zombie counts as ended."""
    try:
        state = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()[0]
    except OSError:
        return True
    return state == 'Z'


def test_a_number_of_processes_is_parsed_and_an_invalid_one_is_rejected():
    for text in ['1', '2', '1000']:
        assert process_count(text) == int(text)
    for text in ['0', '-1', '1001', '1.5', 'two', '', '²', '٣']:
        complaint = f'{text!r} must be a whole number from 1 to 1000'
        with pytest.raises(argparse.ArgumentTypeError, match=complaint):
            process_count(text)


def test_each_process_has_one_thread_and_finishes_its_unawaited_tasks(monkeypatch, tmp_path):
    monkeypatch.setenv(THREADS[0], '7')
    monkeypatch.delenv(THREADS[1], raising=False)
    before = dict(os.environ)
    with local_processes(1) as processes:
        threads = [result(processes, os.getenv, name) for name in THREADS]
        for name in 'abc':
            processes.submit((tmp_path / name).touch)
    assert threads == ['1', '1', '1']
    assert dict(os.environ) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a', 'b', 'c']
    assert not multiprocessing.active_children()


@pytest.fixture
def gate(tmp_path):
    """A pipe that a task reads until the test writes."""
    path = tmp_path / 'gate'
    os.mkfifo(path)
    return path


def test_tasks_are_yielded_as_they_finish_including_later_submissions(gate):
    with local_processes(2) as processes:
        processes.submit(gate.read_text)
        for number in range(5):
            processes.submit(abs, number)
        finished = []
        for future in processes.finished():
            finished.append(future.result())
            if len(finished) == 2:
                processes.submit(abs, 5)
            if len(finished) == 6:
                gate.write_text('open')
    assert finished == [*range(6), 'open']


def test_after_a_task_error_and_an_unknown_task_the_process_continues(monkeypatch):
    def here() -> None:
        pass

    here.__module__, here.__qualname__ = 'argparse', 'here'
    monkeypatch.setattr(argparse, 'here', here, raising=False)
    with local_processes(1) as processes:
        with pytest.raises(ValueError, match='invalid literal') as raised:
            result(processes, int, 'seven')
        assert 'in _run' in str(raised.value.__cause__)
        with pytest.raises(AttributeError, match="attribute 'here'"):
            result(processes, here)
        assert result(processes, abs, -1) == 1


@pytest.mark.parametrize(
    ('task', 'complaint'),
    [
        (
            (signal.raise_signal, signal.SIGKILL),
            r'was ended by a signal \(Killed\) before .* use fewer --workers',
        ),
        (
            (signal.raise_signal, signal.SIGSEGV),
            r'was ended by a signal \(Segmentation fault\) before its task was done$',
        ),
        ((os._exit, 3), 'ended with 3 before its task was done$'),
    ],
)
def test_a_process_that_ends_too_early_is_reported(task, complaint):
    ended = pytest.raises(ChildProcessError, match=rf'process \d+ {complaint}')
    with ended, local_processes(1) as processes:
        result(processes, *task)
    assert not multiprocessing.active_children()


def test_only_the_processes_of_the_pool_end_if_the_work_fails():
    other = multiprocessing.get_context('spawn').Process(target=time.sleep, args=(3600,))
    other.start()
    try:
        with pytest.raises(ZeroDivisionError, match='a test'):
            fail_while_one_works()
        assert multiprocessing.active_children() == [other]
    finally:
        other.kill()
        other.join()


def test_processes_end_when_their_parent_is_killed(tmp_path):
    command = command_of(ORPHANING, tmp_path)
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout
        child = int(parent.stdout.readline())
        assert not has_ended(child)
        parent.kill()
        deadline = time.monotonic() + LONGEST_WAIT
        while not has_ended(child):
            assert time.monotonic() < deadline, f'process {child} has outlived its parent'
            time.sleep(0.02)


def test_the_first_processes_of_a_program_do_not_receive_ctrl_c(tmp_path):
    command = command_of(MASKS, tmp_path)
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    assert said.stdout == '[True, True]\n'


@pytest.mark.parametrize(('number', 'delay'), [(signal.SIGINT, 0.0), (signal.SIGTERM, 0.003)])
def test_an_interrupt_ends_the_pool_while_results_are_sent(number, delay, tmp_path):
    command = command_of(SENDING, tmp_path)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout
        assert parent.stdout.readline() == 'sending\n'
        time.sleep(delay)
        parent.send_signal(number)
        try:
            _, complaint = parent.communicate(timeout=LONGEST_WAIT)
        finally:
            parent.kill()
    assert parent.returncode == -number
    assert complaint.count('Traceback') == (number == signal.SIGINT)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_deferred_interrupt_is_raised_afterwards(number):
    reached = []

    def interrupted() -> None:
        with defer_interrupts():
            os.kill(os.getpid(), number)
            time.sleep(0.1)
            reached.append('the end')

    handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    ended = threading.Event()
    # This thread receives the signal while the main thread blocks it.
    other = threading.Thread(target=ended.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, handler)
        ended.set()
        other.join()
    assert reached == ['the end']
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


ANGLES = tuple(0.1 + 0.01 * number for number in range(100))
STUDY = SweepStudy(
    'mine', 'motion', {'number_of_rotors': 5}, (Axis('rest_angle', ANGLES),), (0, 1)
)


class Clock:
    """Replacement of the module time, in which each row takes its given duration [s]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: list[float]) -> None:
        self.now = 0.0

        def cells(_study: SweepStudy, row: int) -> list[str]:
            self.now += seconds[row]
            return [str(row)]

        monkeypatch.setattr(study_workers, 'time', self)
        monkeypatch.setattr(SweepStudy, 'cells', cells)

    def perf_counter(self) -> float:
        return self.now


@pytest.mark.parametrize('seconds', [0.001, 0.1, 5.0])
def test_a_chunk_takes_about_a_second_or_one_row(seconds, monkeypatch):
    Clock(monkeypatch, [seconds] * STUDY.rows)
    pool = Here()
    done = list(measure_rows(pool, STUDY, range(STUDY.rows)))
    assert sorted(int(row[0]) for cells in done for row in cells) == list(range(STUDY.rows))
    longest = max(spent for *_, spent in pool.results)
    assert longest <= max(1.0, seconds) + seconds
    if seconds == 0.1:
        assert sum(len(rows) for rows, *_ in pool.results if len(rows) > 5) > STUDY.rows / 2


def test_slow_rows_are_removed_from_their_chunk(monkeypatch):
    Clock(monkeypatch, [0.001] * 100 + [3.0] * 100)
    pool = Here()
    done = list(measure_rows(pool, STUDY, range(STUDY.rows)))
    assert sorted(int(row[0]) for cells in done for row in cells) == list(range(STUDY.rows))
    assert max(spent for *_, spent in pool.results) <= 1 + 3


def test_a_cluster_that_does_not_answer_is_reported():
    pytest.importorskip('distributed', reason='needs Dask: pip install distributed')
    complaint = r'--scheduler tcp://127.0.0.1:9 does not answer'
    with pytest.raises(ValueError, match=complaint), cluster('tcp://127.0.0.1:9', timeout=0.5):
        pass


def test_without_the_package_a_cluster_is_rejected(monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    complaint = 'not installed; run pip install distributed, or use --workers'
    with pytest.raises(ValueError, match=complaint), cluster('tcp://127.0.0.1:9'):
        pass
