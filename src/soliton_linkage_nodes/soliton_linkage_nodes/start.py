# SPDX-License-Identifier: Apache-2.0
"""Where every program begins: a signal ends it at once until it sets handlers of its own.

Importing a program takes a second, many on a busy machine. A KeyboardInterrupt would end that with
a trace, or get lost where libraries call Python back.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import threading
from functools import partial
from importlib import import_module
from pathlib import Path

INTERRUPTED = 130
"""Exit code of what Ctrl-C ended, as shells tell it: 128 and the number of SIGINT."""
_STOPPED = 0
"""Exit code of a node that SIGINT or SIGTERM ended, which is how nodes end."""
_LEAST_ADDRESS_SPACE = 1536 * 2**20
"""That a node needs [B]: 1.4 GB of a steering, nearly all of it the stacks and arenas of threads.
With less its libraries hang or end with words of their own, some after it has begun."""
_FEWEST_FILES = 64
"""That a node needs open, of which two dozen are sockets and libraries."""
_FEWEST_THREADS = 24
"""That a node needs, most of them of the middleware."""


def _start(program: str, interrupted: int = INTERRUPTED) -> None:
    """Import a program and run it; `interrupted` is the exit code after SIGINT or SIGTERM."""

    def end(_number: int, _frame: object) -> None:
        os._exit(interrupted)

    signal.signal(signal.SIGINT, end)
    signal.signal(signal.SIGTERM, end)
    if interrupted == _STOPPED:
        _check_limits()
    try:
        import_module(f'soliton_linkage_nodes.{program}').main()
    finally:
        # Python takes its handlers away before it has ended, and a second signal would kill it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _check_limits() -> None:
    """End a node, with one line, where the system allows it less than it needs."""
    if not _allows(resource.RLIMIT_AS, _LEAST_ADDRESS_SPACE):
        kibibytes = _LEAST_ADDRESS_SPACE // 1024
        _refuse(f'{kibibytes} KiB of address space', f'ulimit -v {kibibytes}')
    if not _allows(resource.RLIMIT_NOFILE, _FEWEST_FILES):
        _refuse(f'{_FEWEST_FILES} open files', f'ulimit -n {_FEWEST_FILES}')
    if not _can_start(_FEWEST_THREADS):
        _refuse(f'{_FEWEST_THREADS} threads', 'ulimit -u, or pids.max of its control group')


def _allows(limit: int, least: int) -> bool:
    allowed, _ = resource.getrlimit(limit)
    return allowed == resource.RLIM_INFINITY or allowed >= least


def _can_start(number: int) -> bool:
    """Whether the system lets so many threads run side by side."""
    end = threading.Event()
    threads = []
    try:
        for _ in range(number - threading.active_count()):
            threads.append(threading.Thread(target=end.wait, daemon=True))
            threads[-1].start()
    except RuntimeError:
        return False
    finally:
        end.set()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
    return True


def _refuse(needed: str, remedy: str) -> None:
    sys.exit(
        f'{Path(sys.argv[0]).name}: a node needs {needed}, more than it may have; raise {remedy}'
    )


simulator = partial(_start, 'simulator.node', _STOPPED)
edge_actuator = partial(_start, 'edge_actuator.node', _STOPPED)
chain_identifier = partial(_start, 'chain_identifier.node', _STOPPED)
soliton_analyser = partial(_start, 'soliton_analyser.node', _STOPPED)
soliton_steering = partial(_start, 'soliton_steering.node', _STOPPED)
bag_recorder = partial(_start, 'bags.recorder', _STOPPED)
bag_player = partial(_start, 'bags.player', _STOPPED)
live_view = partial(_start, 'live_view.node', _STOPPED)
visualisation = partial(_start, 'visualisation.node', _STOPPED)
foxglove_server = partial(_start, 'foxglove_server.node', _STOPPED)
camera_encoders = partial(_start, 'camera_encoders.node', _STOPPED)
serial_encoders = partial(_start, 'serial_encoders.node', _STOPPED)

analyse_bag = partial(_start, 'programs.analyse_bag')
calibrate_camera = partial(_start, 'programs.calibrate_camera')
check_bag = partial(_start, 'programs.check_bag')
contraction = partial(_start, 'programs.contraction')
experiment = partial(_start, 'programs.experiment.program')
film_encoders = partial(_start, 'programs.film_encoders')
identify_chain = partial(_start, 'programs.identify_chain.program')
live = partial(_start, 'live_view.session')
move_soliton = partial(_start, 'programs.move_soliton')
nudge = partial(_start, 'programs.nudge')
print_markers = partial(_start, 'programs.print_markers')
recover_bag = partial(_start, 'programs.recover_bag')
robot_description = partial(_start, 'programs.robot_description')
simulated_controller = partial(_start, 'programs.simulated_controller')
suite = partial(_start, 'programs.suite.program', _STOPPED)
watch_soliton = partial(_start, 'programs.watch_soliton')
