# SPDX-License-Identifier: Apache-2.0
"""A signal ends every program without a trace while it is still starting."""

from __future__ import annotations

import signal
from collections.abc import Callable
from importlib.metadata import distribution

import pytest
from programs import Program, signalled

NODES = (
    'simulator',
    'edge_actuator',
    'soliton_analyser',
    'soliton_steering',
    'bag_recorder',
    'bag_player',
    'watch_soliton',
)
TOOLS = (
    'analyse_bag',
    'check_bag',
    'contraction',
    'experiment',
    'move_soliton',
    'nudge',
    'recover_bag',
)


def test_these_are_the_programs() -> None:
    programs = distribution('soliton_linkage_nodes').entry_points.names
    assert programs == {*NODES, *TOOLS}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_every_program_that_is_being_imported(
    start: Callable[..., Program], number: signal.Signals
) -> None:
    programs = {
        name: start(name, command=signalled(f'/{name}.py:<module>', number))
        for name in (*NODES, *TOOLS)
    }
    for name, program in programs.items():
        assert program.wait() == (130 if name in TOOLS else 0), name
        assert program.said == [], name


@pytest.mark.parametrize(
    'moment',
    [
        'soliton_linkage_nodes/soliton_analyser.py:<module>',
        'rclpy/impl/implementation_singleton.py:<module>',
        'numpy/__init__.py:<module>',
        'scipy/integrate/__init__.py:<module>',
        'soliton_linkage/cycle.py:<module>',
        'soliton_linkage_nodes/process.py:<module>',
        'soliton_linkage_nodes/process.py:run',
        'soliton_linkage_nodes/process.py:stop_on_signals',
        'soliton_linkage_nodes/process.py:initialise',
        'soliton_linkage_nodes/scheduling.py:__init__',
        'soliton_linkage_nodes/soliton_analyser.py:__init__',
        'rclpy/node.py:create_subscription',
        'soliton_linkage_nodes/scheduling.py:look',
    ],
)
def test_a_signal_ends_the_analyser_wherever_its_start_has_got_to(
    start: Callable[..., Program], moment: str
) -> None:
    program = start('soliton_analyser', command=signalled(moment, signal.SIGINT))
    assert program.wait() == 0
    assert program.said == []
