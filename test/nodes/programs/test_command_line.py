# SPDX-License-Identifier: Apache-2.0
"""Errors of a command line and failures of a program are reported on one line."""

import errno
import os

import pytest

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_nodes.programs.command_line import (
    exit_on_failure,
    number,
    parse_own_arguments,
)


@pytest.fixture
def parser():
    parser = PlainParser(prog='push')
    parser.add_argument('force', type=number(Quantity('of the push', 'N', -10.0, 10.0)))
    parser.add_argument('--times', type=number(Quantity('how often', minimum=1), int), default=1)
    return parser


def test_a_wrong_command_line_ends_in_one_line(parser, capfd):
    for arguments, said in [
        ([], 'the following arguments are required: force'),
        (['hard'], "argument force: 'hard' must be a finite number in the range -10 to 10 N"),
        (['nan'], "argument force: 'nan' must be a finite number in the range -10 to 10 N"),
        (['-inf'], "argument force: '-inf' must be a finite number in the range -10 to 10 N"),
        (['-2e1'], "argument force: '-2e1' must lie in the range -10 to 10 N"),
        (['1', '--times', '0'], "argument --times: '0' must be 1 or more"),
        (['1', '--bogus'], '--bogus: unknown'),
        (['1', '2'], '2: unknown'),
        (['1', '-r', '__ns:=/a'], 'put ROS arguments after --ros-args, e.g. --ros-args -r '),
        (
            ['1', '--ros-args', '-p'],
            "wrong ROS arguments: Failed to parse ROS arguments: Couldn't",
        ),
    ]:
        with pytest.raises(SystemExit) as end:
            parse_own_arguments(parser, arguments)
        assert end.value.code == 2
        line = capfd.readouterr().err.splitlines()[-1]
        assert line.startswith(f'push: {said}')
        assert line.endswith('; see push --help')
        assert '.c:' not in line


def test_ros_has_its_arguments_and_numbers_may_be_negative(parser):
    options = parse_own_arguments(
        parser, ['-1e-3', '--times', '2', '--ros-args', '-r', '__ns:=/left']
    )
    assert vars(options) == {'force': -1e-3, 'times': 2}


def test_a_failure_ends_in_one_line():
    for error, code in [
        (ValueError('too much'), 'push: too much'),
        (RuntimeError('no parse, at /src/a.c:3, at /b.c:4'), 'push: no parse'),
        (OSError(errno.ENOENT, os.strerror(errno.ENOENT), 'here'), 'push: here: No such file'),
        (OSError('gone'), 'push: gone'),
        (KeyboardInterrupt(), 130),
    ]:
        with pytest.raises(SystemExit) as end, exit_on_failure('push'):
            raise error
        if isinstance(code, int):
            assert end.value.code == code
        else:
            assert str(end.value.code).startswith(code)
