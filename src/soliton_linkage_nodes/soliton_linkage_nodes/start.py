# SPDX-License-Identifier: Apache-2.0
"""Entry points of all nodes and programs.

While a program is imported, which takes seconds on a busy machine, SIGINT ends the process at
once. A KeyboardInterrupt would instead print a traceback, or a library would suppress it.
"""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells: 128 + number of SIGINT."""
CLOSED_PIPE = 141
"""Exit code after the reader of the standard output has closed it: 128 + number of SIGPIPE."""
_THREADS = 'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'
"""Environment variables that set the number of threads of linear algebra libraries."""


def _start(program: str, node: str = '') -> None:
    """Run the node class `node` of a module; without `node`, call the function `main`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # The matrices are small. With one thread per core, an identification takes three times the
    # processor time, because threads wait for each other. Environment variables of the user have
    # precedence.
    for variable in _THREADS:
        os.environ.setdefault(variable, '1')
    try:
        try:
            module = import_module(f'soliton_linkage_nodes.{program}')
            if node:
                import_module('soliton_linkage_nodes.runtime.process').run(getattr(module, node))
            else:
                module.main()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Python writes to the closed pipe again when it exits. Redirect this output.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(CLOSED_PIPE)
    finally:
        # Python removes its signal handlers when it exits. A second signal would then kill the
        # process.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


simulator = partial(_start, 'simulator.node', 'Simulator')
edge_actuator = partial(_start, 'edge_actuator.node', 'EdgeActuator')
chain_identifier = partial(_start, 'chain_identifier.node', 'ChainIdentifier')
soliton_analyser = partial(_start, 'soliton_analyser.node', 'SolitonAnalyser')
soliton_steering = partial(_start, 'soliton_steering.node', 'SolitonSteering')
bag_recorder = partial(_start, 'bags.recorder', 'BagRecorder')
bag_player = partial(_start, 'bags.player', 'BagPlayer')
live_view = partial(_start, 'live_view.node', 'LiveView')
visualisation = partial(_start, 'visualisation.node', 'Visualisation')
foxglove_server = partial(_start, 'foxglove_server.node', 'FoxgloveServer')
camera_encoders = partial(_start, 'camera_encoders.node', 'CameraEncoders')
serial_encoders = partial(_start, 'serial_encoders.node', 'SerialEncoders')

analyse_bag = partial(_start, 'programs.analyse_bag')
calibrate_camera = partial(_start, 'programs.calibrate_camera')
check_bag = partial(_start, 'programs.check_bag')
check_rig = partial(_start, 'programs.check_rig')
contraction = partial(_start, 'programs.contraction')
experiment = partial(_start, 'programs.experiment.program')
film_encoders = partial(_start, 'programs.film_encoders')
identify_chain = partial(_start, 'programs.identify_chain')
live = partial(_start, 'live_view.session')
move_soliton = partial(_start, 'programs.move_soliton')
nudge = partial(_start, 'programs.nudge')
print_markers = partial(_start, 'programs.print_markers')
recover_bag = partial(_start, 'programs.recover_bag')
robot_description = partial(_start, 'programs.robot_description')
simulated_controller = partial(_start, 'programs.simulated_controller')
suite = partial(_start, 'programs.suite')
watch_soliton = partial(_start, 'programs.watch_soliton')
