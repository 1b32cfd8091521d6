# SPDX-License-Identifier: Apache-2.0
"""The study programs share the command line, the order of results and the exit status."""

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import entry_points

import pytest

from soliton_linkage_studies.program import (
    installed_settings,
    run_parallel,
    run_study,
    select_names,
    study_parser,
)
from soliton_linkage_studies.settings import load_settings

STUDIES = ['accuracy', 'collisions', 'driving', 'figures', 'films', 'moves', 'sweep']
WAITING = """
import functools, sys, time
from soliton_linkage_studies.program import run_study, run_parallel, study_parser

def waited(options):
    tasks = {number: functools.partial(time.sleep, 3600) for number in range(4)}
    return str(run_parallel('waiting', tasks, options.workers))

if __name__ == '__main__':
    sys.exit(run_study(study_parser('waiting', '', 'less'), None, waited, 'nothing is written'))
"""


def gone(group: int) -> bool:
    """Return whether a process group ends within two minutes, including its clean-up."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def failing(error: BaseException) -> Callable[[argparse.Namespace], str]:
    def study(_: argparse.Namespace) -> str:
        raise error

    return study


def test_each_study_is_a_command(capsys):
    for name in STUDIES:
        found = entry_points(group='soliton_linkage.commands')
        main = next(each.load() for each in found if each.name == name)
        with pytest.raises(SystemExit, match='0'):
            main(['--help'])
        shown = capsys.readouterr().out
        assert shown.startswith(f'usage: soliton-linkage {name} ')
        for option in ('--output', '--quick', '--workers'):
            assert option in shown


def test_a_wrong_command_line_ends_in_one_line(capsys):
    for wrong in [['--bogus'], ['--workers', '0'], ['a.yaml', 'b.yaml'], ['--output'], ['--only']]:
        parser = study_parser('figures', None, 'fewer points', selective=True)
        with pytest.raises(SystemExit, match='2'):
            run_study(parser, wrong, failing(RuntimeError('begun')), '')
        said = capsys.readouterr().err
        assert said.startswith('soliton-linkage figures: ')
        assert said.endswith('; see soliton-linkage figures --help\n')
        assert said.count('\n') == 1


def test_each_study_has_installed_settings():
    for name in [*(name for name in STUDIES if name != 'sweep'), 'phase_diagram']:
        path = installed_settings(name)
        assert path is not None
        assert load_settings(path).values


def test_settings_that_are_not_installed_must_be_specified(capsys):
    assert installed_settings('none') is None
    with pytest.raises(SystemExit, match='2'):
        study_parser('none', '', 'less').parse_args([])
    assert 'the following arguments are required: config' in capsys.readouterr().err


def test_names_are_selected_in_full_or_by_their_first_part():
    known = ['S1_one', 'S2_two', 'S22_more', 'plain']
    assert select_names(known, []) == known
    assert select_names(known, ['plain', 'S2', 'S1_one']) == ['S1_one', 'S2_two', 'plain']
    with pytest.raises(ValueError, match=r'--only S3: unknown name; choose from S1_one, S'):
        select_names(known, ['S2', 'S3'])


def test_results_have_the_order_of_the_tasks(capsys):
    names = ['c', 'a', 'b', 'd']
    results = run_parallel('naming', {name: name.upper for name in names}, 2)
    assert list(results.items()) == [(name, name.upper()) for name in names]
    assert 'naming: 4 done in' in capsys.readouterr().err


def test_a_failed_study_prints_its_error_in_one_line(capsys):
    for error, status, said in [
        (ValueError('length is -1; make it longer'), 1, 'any: length is -1; make it longer\n'),
        (FileNotFoundError(2, 'No such file', 'x'), 1, "any: [Errno 2] No such file: 'x'\n"),
        (ChildProcessError('process 3 has ended'), 1, 'any: process 3 has ended\n'),
        (KeyboardInterrupt(), 130, '\nany: stopped; all is kept\n'),
    ]:
        parser = study_parser('any', '', 'less')
        handler = signal.getsignal(signal.SIGTERM)
        assert run_study(parser, ['any.yaml'], failing(error), 'all is kept') == status
        assert capsys.readouterr().err == said
        assert signal.getsignal(signal.SIGTERM) == handler


def test_the_returned_text_is_printed_last_and_a_programming_error_is_not_hidden(capsys):
    parser = study_parser('any', '', 'less')
    with pytest.raises(KeyError):
        run_study(parser, ['any.yaml'], failing(KeyError('x')), '')
    assert run_study(parser, ['any.yaml', '--quick'], lambda each: f'{each.quick}', '') == 0
    assert capsys.readouterr().out == 'True\n'


def test_a_terminated_study_leaves_no_process(tmp_path):
    script = tmp_path / 'waiting.py'
    script.write_text(WAITING, encoding='utf-8')
    process = subprocess.Popen(
        [sys.executable, str(script), 'any.yaml', '--workers', '2'],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr is not None
    assert '0 of 4' in process.stderr.readline()
    process.terminate()
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert said.endswith('waiting: stopped; nothing is written\n')
    assert 'Traceback' not in said
    assert gone(process.pid)
