# SPDX-License-Identifier: Apache-2.0
"""Where every program begins: a signal ends it at once until it sets handlers of its own.

Importing a program takes a second, many on a busy machine. A KeyboardInterrupt would end that with
a trace, or get lost where libraries call Python back.
"""

from __future__ import annotations

import os
import signal
from functools import partial
from importlib import import_module

INTERRUPTED = 130
"""Exit code of what Ctrl-C ended, as shells tell it: 128 and the number of SIGINT."""
_STOPPED = 0
"""Exit code of a node that SIGINT or SIGTERM ended, which is how nodes end."""


def _start(program: str, interrupted: int = INTERRUPTED) -> None:
    """Import a program and run it; `interrupted` is the exit code after SIGINT or SIGTERM."""

    def end(_number: int, _frame: object) -> None:
        os._exit(interrupted)

    signal.signal(signal.SIGINT, end)
    signal.signal(signal.SIGTERM, end)
    try:
        import_module(f'soliton_linkage_nodes.{program}').main()
    finally:
        # Python takes its handlers away before it has ended, and a second signal would kill it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


simulator = partial(_start, 'simulator.node', _STOPPED)
edge_actuator = partial(_start, 'edge_actuator.node', _STOPPED)
soliton_analyser = partial(_start, 'soliton_analyser.node', _STOPPED)
soliton_steering = partial(_start, 'soliton_steering.node', _STOPPED)
bag_recorder = partial(_start, 'bags.recorder', _STOPPED)
bag_player = partial(_start, 'bags.player', _STOPPED)
live_view = partial(_start, 'live_view.node', _STOPPED)
visualisation = partial(_start, 'visualisation.node', _STOPPED)
foxglove_server = partial(_start, 'foxglove_server.node', _STOPPED)

analyse_bag = partial(_start, 'programs.analyse_bag')
check_bag = partial(_start, 'programs.check_bag')
contraction = partial(_start, 'programs.contraction')
experiment = partial(_start, 'programs.experiment.program')
live = partial(_start, 'live_view.session')
move_soliton = partial(_start, 'programs.move_soliton')
nudge = partial(_start, 'programs.nudge')
recover_bag = partial(_start, 'programs.recover_bag')
robot_description = partial(_start, 'programs.robot_description')
suite = partial(_start, 'programs.suite.program', _STOPPED)
watch_soliton = partial(_start, 'programs.watch_soliton')
