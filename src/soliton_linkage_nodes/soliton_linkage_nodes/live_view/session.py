# SPDX-License-Identifier: Apache-2.0
"""Run the nodes of a simulated chain and the live page until Ctrl-C."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
import webbrowser
from pathlib import Path

from soliton_linkage_nodes.runtime.child_processes import (
    START_LIMIT,
    ChildProcesses,
    has_display,
    page_address,
)
from soliton_linkage_nodes.runtime.process import stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_IDENTIFIER = 'chain_identifier'
_NODES = (*('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering'), _IDENTIFIER)
_PAGE = 'live_view'
_RESTART_DELAY = 1.0
"""Time from the end of a node to its restart [s]."""
_MOST_RESTARTS = 100
"""Number of restarts of nodes after which the program ends with an error [1]."""
_POLL_INTERVAL = 0.1
"""Poll interval for ended processes [s]."""


def main() -> None:
    """Run the simulated chain of a parameter file and the page until Ctrl-C."""
    arguments = _arguments()
    stopping = stop_on_signals()
    output: Path = arguments.output
    processes = ChildProcesses(output / 'log')
    code = 1
    try:
        _start(processes, arguments)
        _open_page(processes, stopping, not arguments.no_browser)
        _respawn(processes, stopping)
        code = INTERRUPTED
        print('Stopping all nodes.', flush=True)
    except RuntimeError as error:
        print(f'\nlive: {error}', file=sys.stderr)
    finally:
        # Stop the page and its recorder first, while all topics are still published.
        processes.stop([_PAGE])
        processes.stop()
    sys.exit(code)


def _start(processes: ChildProcesses, arguments: argparse.Namespace) -> None:
    print(f'Starting {", ".join(_NODES)} and {_PAGE}.', flush=True)
    common = ['--params-file', str(arguments.configuration)]
    environment = dict(os.environ)
    folders = f'[{arguments.output.resolve()},{arguments.bags.resolve()}]'
    page = ['-p', f'bag_folders:={folders}']
    page += ['-p', f'lesson:={str(arguments.lesson).lower()}']
    page += ['-p', f'port:={arguments.port}', '-p', f'host:={arguments.host}']
    processes.start(_PAGE, [*common, *page], environment)
    identified = arguments.output.resolve() / 'identified_chain.yaml'
    own = {_IDENTIFIER: ['-p', 'interval:=0.0', '-p', f'output:={identified}']}
    for node in _NODES:
        processes.start(node, [*common, *own.get(node, [])], environment)


def _respawn(processes: ChildProcesses, stopping: threading.Event) -> None:
    restarts = 0
    while not stopping.wait(_POLL_INTERVAL):
        for node, how in processes.ended().items():
            if restarts == _MOST_RESTARTS:
                raise RuntimeError(f'{how} after {restarts} restarts of nodes; see its log')
            restarts += 1
            print(f'{how}; restarting it.', flush=True)
            if stopping.wait(_RESTART_DELAY):
                return
            processes.restart(node)
            if node == _PAGE:
                _open_page(processes, stopping, False)


def _open_page(processes: ChildProcesses, stopping: threading.Event, show: bool) -> None:
    deadline = time.monotonic() + START_LIMIT
    while not stopping.is_set():
        processes.ended()
        address = page_address(processes.output(_PAGE))
        if address:
            print(f'Press Ctrl-C to stop everything. The page:\n  {address}', flush=True)
            if show and has_display():
                webbrowser.open(address)
            return
        if time.monotonic() > deadline:
            raise RuntimeError(f'{_PAGE} printed no address within {START_LIMIT:g} s; see its log')
        stopping.wait(_POLL_INTERVAL)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='live', description=__doc__)
    parser.add_argument(
        'configuration', type=Path, help='parameter file, such as config/flipper.yaml'
    )
    for option, default, meaning in (
        ('--output', Path('out/live'), 'folder for recordings'),
        ('--bags', Path('bags'), 'folder of bags that the page also lists'),
        ('--port', 8080, 'port of the page'),
        ('--host', '127.0.0.1', 'address that serves the page'),
    ):
        explanation = f'{meaning} (%(default)s)'
        parser.add_argument(option, type=type(default), default=default, help=explanation)
    parser.add_argument(
        '--lesson', action='store_true', help='begin with the guided experiments, in large type'
    )
    parser.add_argument(
        '--no-browser', action='store_true', help='print the address and open no browser'
    )
    arguments = parser.parse_args()
    if not arguments.configuration.is_file():
        parser.exit(
            2,
            f'configuration {str(arguments.configuration)!r} is not a file; '
            'specify a parameter file such as config/flipper.yaml\n',
        )
    return arguments
