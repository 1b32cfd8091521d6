# SPDX-License-Identifier: Apache-2.0
"""Soak test: the whole suite runs for an hour, with nudges, moves, splits and a kill every minute.

A chain of 100 rotors runs at 1000 Hz with all nodes in separate processes, and the live page in a
browser if a browser is installed. Every minute one node is killed with SIGKILL and restarted, some
nodes only in the first half of the test, the other nodes only in the second half. Recorded files
are read and removed. Each event is written to OUTPUT/ledger.jsonl; the page OUTPUT/soak.html is
drawn every few minutes. An interrupted test continues with the same command and --resume. The exit
code is 0 if kills explain all losses and if no memory has grown.
"""

from __future__ import annotations

import argparse
import math
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count, cycle
from pathlib import Path
from typing import Any

import rclpy
from live import BROWSERS, PORT, Reports, chromium, heap, memory, visit
from processes import node_command, own_domain, processor_time
from rclpy.action import ActionClient
from rclpy.node import Node
from soak_page import verdicts, write_page
from soak_records import BagAudit, Ledger
from std_msgs.msg import Float64

from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.runtime import interfaces

ROTORS, RATE = 100, 1000.0
DAMPING = 2e-5
PICTURES = 10.0
NUDGE = 3.0
POSITIONS = (30.0, 70.0, 50.0)
NUDGES, MOVES, SPLITS, SAMPLES, KILLS, PAGES, HEAPS = 5.0, 20.0, 30.0, 5.0, 60.0, 300.0, 30.0
LONGEST_STOP = 30.0
RESTART_DELAY = 10.0
END_WITH_PARENT = ('setpriv', '--pdeathsig', 'KILL')
SPIN = 0.05
NODES: dict[str, dict[str, Any]] = {
    'simulator': {
        'chain.number_of_rotors': ROTORS,
        'chain.damping': DAMPING,
        'publish_rate': RATE,
        'integrator': 'symplectic',
        'initial_state': 'soliton',
        'initial_position': ROTORS / 2,
    },
    'edge_actuator': {},
    'soliton_analyser': {},
    'soliton_steering': {},
    'bag_recorder': {'max_bag_duration': 20.0},
    'live_view': {'port': PORT, 'frame_rate': PICTURES},
    'visualisation': {},
}
FIGURES = {
    'simulator': ('real-time factor', 'missed deadlines', 'energy [J]', 'energy drift'),
    'soliton_analyser': ('late frames',),
    'bag_recorder': ('lost messages', 'bytes waiting for the disk'),
}


class Suite:
    """Nodes in processes, and their diagnostics."""

    def __init__(self, output: Path, ledger: Ledger) -> None:
        self._output = output
        self._ledger = ledger
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._lives = count(len(ledger.of('start')))
        self._life: dict[str, int] = {}
        self._dead: dict[str, float] = {}
        self._audit: BagAudit | None = None
        self._began = 0

    def start(self, name: str) -> None:
        """Start or restart a node."""
        life = next(self._lives)
        settings = dict(NODES[name])
        if name == 'bag_recorder':
            bag = self._output / 'bags' / f'life_{life}'
            settings['output'] = bag
            self._began = time.time_ns()
            self._audit = BagAudit(bag.with_name(f'{bag.name}_0'), RATE)
        with (self._output / f'{name}.log').open('ab') as log:
            command = [*END_WITH_PARENT, *map(str, node_command(name, settings))]
            output: Any = {'stdout': log, 'stderr': log}
            self._running[name] = subprocess.Popen(command, start_new_session=True, **output)
        self._life[name] = life
        self._ledger.note('start', node=name, life=life)

    def restart_ended(self) -> None:
        """Restart nodes that ended unexpectedly, after a pause."""
        for name, process in list(self._running.items()):
            if process.poll() is not None and name not in self._dead:
                self._ended(name, 'died', code=process.returncode)
                self._dead[name] = time.monotonic()
            elif self._dead.get(name, math.inf) < time.monotonic() - RESTART_DELAY:
                del self._dead[name]
                self.start(name)

    def kill(self, name: str) -> None:
        """Kill a node and start it again."""
        if name in self._dead:
            return
        self._running[name].kill()
        self._running[name].wait()
        self._ended(name, 'kill')
        self.start(name)

    def sample(self) -> None:
        """Record the resources of each process."""
        for name, process in self._running.items():
            folder = Path(f'/proc/{process.pid}')
            try:
                sample = {
                    'memory': memory(process.pid),
                    'threads': len(list((folder / 'task').iterdir())),
                    'descriptors': len(list((folder / 'fd').iterdir())),
                    'processor': processor_time(process.pid),
                }
            except (OSError, IndexError):
                continue
            self._ledger.note('sample', node=name, life=self._life[name], **sample)

    def audit(self) -> None:
        """Read the finished files of the recorder."""
        if self._audit:
            self._audit.read(ended=False)

    def stop(self) -> None:
        """Stop all nodes with SIGINT."""
        for process in self._running.values():
            process.send_signal(signal.SIGINT)
        for name, process in self._running.items():
            try:
                process.wait(LONGEST_STOP)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if name not in self._dead:
                self._ended(name, 'end', code=process.returncode)

    def _ended(self, name: str, how: str, **more: Any) -> None:
        self._ledger.note(how, node=name, life=self._life[name], **more)
        if name == 'bag_recorder' and self._audit:
            self._audit.read(ended=True)
            entry = self._audit.entry()
            entry['last'] = self._ledger.since(entry['last'] or self._began)
            entry['gaps'] = [[self._ledger.since(s) for s in gap] for gap in entry['gaps']]
            self._ledger.note('bag', life=self._life[name], killed=how == 'kill', **entry)
            shutil.rmtree(self._audit.folder, ignore_errors=True)


class User:
    """Client that sends nudges, moves and requests for new files, and receives diagnostics."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self.node = Node('soak')
        self._reports = Reports(self.node)
        self._nudges = interfaces.NUDGE.publisher(self.node)
        self._moves = ActionClient(self.node, MoveSoliton, interfaces.MOVE_SOLITON)
        split = service_type('SplitBagfile')
        self._splits = self.node.create_client(split, 'bag_recorder/split_bagfile')
        self._signs = cycle((1, -1))
        self._positions = cycle(POSITIONS)

    def nudge(self) -> None:
        """Nudge in alternating directions."""
        self._nudges.publish(Float64(data=NUDGE * next(self._signs)))
        self._ledger.note('nudge')

    def move(self) -> None:
        """Request a move, and record its result."""
        rotor = next(self._positions)
        requested = self._ledger.note('move', rotor=rotor)
        if not self._moves.server_is_ready():
            return
        goal = MoveSoliton.Goal(rotor=rotor)
        self._moves.send_goal_async(goal).add_done_callback(
            lambda sent: self._follow(sent, requested['time'])
        )

    def split(self) -> None:
        """Request a new file of the recorder."""
        if self._splits.service_is_ready():
            self._splits.call_async(self._splits.srv_type.Request())
            self._ledger.note('split')

    def record_diagnostics(self) -> None:
        """Record the last diagnostics of the nodes."""
        for name, figures in FIGURES.items():
            report = self._reports.pop(name, {})
            values = {figure: float(report[figure]) for figure in figures if figure in report}
            if values:
                self._ledger.note('report', node=name, **values)

    def _follow(self, sent: Any, requested: float) -> None:
        handle = sent.result()
        if handle is not None and handle.accepted:
            handle.get_result_async().add_done_callback(lambda ended: self._end(ended, requested))

    def _end(self, ended: Any, requested: float) -> None:
        result = ended.result()
        if result is not None:
            move = result.result
            moved = {'outcome': move.outcome, 'message': move.message}
            self._ledger.note('moved', requested=requested, **moved)


class Visitor:
    """Browser with the live page, if a browser is installed."""

    def __init__(self, stack: ExitStack, ledger: Ledger) -> None:
        self._ledger = ledger
        self._page: Any = None
        self._browser: Any = None
        if any(map(shutil.which, BROWSERS)):
            try:
                self._browser = stack.enter_context(chromium())
            except (Exception, SystemExit) as error:
                ledger.note('no browser', why=str(error))

    def poll_page(self) -> None:
        """Open the page, or record the memory of its script."""
        if self._browser is None:
            return
        try:
            if self._page is None:
                self._page = visit(self._browser)
            drawn = self._page.evaluate('live.drawn')
            self._ledger.note('page', heap=heap(self._page), drawn=drawn)
        except Exception as error:
            self._ledger.note('page lost', why=str(error).partition('\n')[0])
            self._page = None


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument('--minutes', type=float, default=60.0, help='(%(default)s)')
    parser.add_argument('--resume', action='store_true', help='continue an interrupted test')
    parser.add_argument('--output', type=Path, default=Path('out/soak'), help='(%(default)s)')
    arguments = parser.parse_args()
    output = arguments.output
    if not arguments.resume:
        shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True, exist_ok=True)
    stopping = threading.Event()
    ledger = Ledger(output / 'ledger.jsonl')
    with own_domain(), ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopping.set())
        run(output, ledger, 60 * arguments.minutes, stopping, stack)
    page, results = write_page(output, ledger), verdicts(ledger)
    print('\n'.join(f'{"   ok" if good else " FAIL"}: {line}' for line, good in results))
    print(f'page: {page}')
    sys.exit(0 if all(good for _, good in results) and not stopping.is_set() else 1)


def run(
    output: Path, ledger: Ledger, seconds: float, stopping: threading.Event, stack: ExitStack
) -> None:
    """Run for a duration [s], or until stopped."""
    suite, user = Suite(output, ledger), User(ledger)
    stack.callback(user.node.destroy_node)
    stack.callback(suite.stop)
    for name in NODES:
        suite.start(name)
    visitor = Visitor(stack, ledger)

    def kill() -> None:
        # In each half of the test some nodes are not killed, so that the growth of their memory is
        # measured.
        names = list(NODES)
        half = names[: len(names) // 2] if ledger.now < seconds / 2 else names[len(names) // 2 :]
        suite.kill(half[len(ledger.of('kill')) % len(half)])

    actions: list[tuple[float, Callable[[], object]]] = [
        (SAMPLES, suite.sample),
        (SAMPLES, user.record_diagnostics),
        (SAMPLES, suite.audit),
        (NUDGES, user.nudge),
        (MOVES, user.move),
        (SPLITS, user.split),
        (HEAPS, visitor.poll_page),
        (KILLS, kill),
        (PAGES, lambda: write_page(output, ledger)),
    ]
    due = [time.monotonic() + period for period, _ in actions]
    progress = ProgressLine('soak test', seconds)
    while ledger.now < seconds and not stopping.is_set():
        rclpy.spin_once(user.node, timeout_sec=SPIN)
        suite.restart_ended()
        for number, (period, act) in enumerate(actions):
            if time.monotonic() >= due[number]:
                due[number] = time.monotonic() + period
                act()
        progress.show(ledger.now)
    progress.end(f'{ledger.now / 60:.1f} minutes')


if __name__ == '__main__':
    main()
