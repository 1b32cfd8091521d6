# SPDX-License-Identifier: Apache-2.0
"""One command has all sub-commands, imports only the requested one, and ends as `ros2` does."""

import argparse
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from typing import Any

import pytest

from soliton_linkage import command
from soliton_linkage.command_line import complete, skip_word, words_before


def failing(arguments: list[str]) -> int:
    """Raise what the first argument names."""
    raise {'interrupt': KeyboardInterrupt, 'value': ValueError, 'module': ModuleNotFoundError}[
        arguments[0]
    ](arguments[1])


@pytest.fixture
def entries(monkeypatch):
    entry = EntryPoint('fail', f'{__name__}:failing', 'soliton_linkage.commands')
    monkeypatch.setattr(EntryPoint, 'load', lambda _: failing)
    monkeypatch.setattr(command, 'entry_points', lambda **_: [entry])


@pytest.mark.parametrize(
    ('given', 'code', 'said'),
    [
        (['interrupt', ''], signal.SIGINT, ''),
        (['value', 'mass = -1 must be above 0'], 1, 'mass = -1 must be above 0'),
        (
            ['module', "No module named 'rclpy'"],
            1,
            "No module named 'rclpy'; install it, or source",
        ),
    ],
)
@pytest.mark.usefixtures('entries')
def test_errors_are_one_line_and_a_code(capsys, given, code, said):
    assert command.main(['fail', *given]) == code
    shown = capsys.readouterr().err
    assert shown.count('\n') == (1 if said else 0)
    assert shown.startswith(f'soliton-linkage fail: {said}' if said else '')


@pytest.mark.usefixtures('entries')
def test_without_a_command_there_is_help(capsys):
    assert command.main([]) == 0
    assert 'fail' in capsys.readouterr().out
    with pytest.raises(SystemExit, match='2'):
        command.main(['bogus'])
    said = capsys.readouterr().err
    assert said.startswith(
        'soliton-linkage: unknown command bogus; known commands are fail; source'
    )
    assert said.count('\n') == 1


def test_a_study_without_its_package_names_the_package_to_install(monkeypatch, capsys):
    monkeypatch.setattr(command, 'entry_points', lambda **_: [])
    with pytest.raises(SystemExit, match='2'):
        command.main(['figures', '--quick'])
    assert (
        'for studies, install soliton_linkage_studies with pip, or by the rosdep key '
        'soliton_linkage_studies; see'
    ) in capsys.readouterr().err


def test_help_and_a_first_chain_import_no_unused_module():
    code = 'import sys; from soliton_linkage.command import main; main([]); print(*sys.modules); '
    code += 'import soliton_linkage; soliton_linkage.Chain(); print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    *shown, imported, later = done.stdout.splitlines()
    assert not {'numpy', 'numba', 'matplotlib', 'rclpy'} & set(imported.split())
    assert not {'numba', 'matplotlib', 'soliton_linkage.estimation'} & set(later.split())
    assert any(line.split()[:3] == ['figures', 'Draw', 'the'] for line in shown)


def test_the_parser_of_a_sub_command_completes_its_line(monkeypatch):
    assert words_before() == []
    line = 'soliton-linkage sweep --qu'
    for name, value in (
        ('COMP_LINE', line),
        ('COMP_POINT', str(len(line))),
        ('_ARGCOMPLETE', '1'),
    ):
        monkeypatch.setenv(name, value)
    assert words_before() == ['sweep']
    skip_word()
    asked: list[Any] = []
    module = type(sys)('argcomplete')
    monkeypatch.setitem(sys.modules, 'argcomplete', module)
    monkeypatch.setattr(
        module, 'autocomplete', lambda parser, **_: asked.append(parser), raising=False
    )
    parser = argparse.ArgumentParser()
    complete(parser)
    assert asked == [parser]
