# SPDX-License-Identifier: Apache-2.0
"""Steps of the experiment: nudge the chain, watch the soliton, record, and replay the bag."""

from __future__ import annotations

import json
import math
import os
import shutil
import threading
import time
import webbrowser
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.experimental import EventsExecutor
from std_msgs.msg import Float64

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.programs.experiment.observer import Observer, RoundTrip
from soliton_linkage_nodes.programs.watch_soliton import ChainLine
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.child_processes import (
    START_LIMIT,
    ChildProcesses,
    has_display,
    page_address,
)
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS
from soliton_linkage_nodes.runtime.process import interruptible, spin_until
from soliton_linkage_nodes.runtime.stamps import SECOND

_REPORT = 'soliton_linkage_nodes.programs.experiment.report'
_NODES = ('bag_recorder', 'soliton_analyser', 'edge_actuator', 'simulator')
_PAGE = 'live_view'
_ALL_FRAMES = ['-p', 'longest_lag:=0.0']
"""Arguments that make an analyser analyse every frame, even if it lags behind."""
_UNUSED = (
    *(interfaces.IDENTIFIED_CHAIN, interfaces.JOINT_STATE_DEVIATIONS, interfaces.DIAGNOSTICS),
    *(interfaces.EDGE_COMMAND, interfaces.JOINT_COMMANDS, interfaces.EFFORT_COMMANDS),
    *(interfaces.JOINT_TRAJECTORY, interfaces.TILT),
)
_RECORDED_TOPICS = {f'/{topic.name}' for topic in interfaces.SUITE_TOPICS if topic not in _UNUSED}
_REPORT_LIMIT = 6.2
"""Longest wait for a report of a node [s]. Nodes report once per second."""
_print = partial(print, flush=True)
_QUIET = 0.5
"""If no further state arrives for this time [s], all states have arrived."""


class Experiment:
    """Experiment with a simulated chain, from the start of the nodes to the replay of the bag."""

    def __init__(
        self,
        configuration: Path,
        output: Path,
        observer: Observer,
        stopping: threading.Event,
        page: bool = False,
    ) -> None:
        """Prepare the experiment; with `page`, a page in the browser will show the chain."""
        self._page = page
        self.bag = output / f'{observer.settings.scenario}_0'
        self._configuration = configuration
        self._output = output
        self._observer = observer
        self._settings = observer.settings
        self._stopping = stopping
        self._executor = EventsExecutor()
        self._executor.add_node(observer)
        self._report: Any = None
        self._processes = ChildProcesses(output / 'log')
        # Remove the recording that a killed experiment may have left.
        if self.bag.exists():
            shutil.rmtree(self.bag)

    def run(self) -> dict[str, Any]:
        """Run all steps and return the summary."""
        try:
            self._start_nodes()
            self._drive()
            self._watch()
            pacing = self._finish()
            self._start_replay()
            recorded = self._draw()
            replayed = self._replay()
        finally:
            self._executor.shutdown()
            self._processes.stop()
        return self._summary(recorded, replayed, pacing)

    def _start_nodes(self) -> None:
        _print(f'Starting {", ".join(_NODES)} in a private domain of this machine.')
        if self._page:
            page = ['-p', 'port:=0', '-p', 'read_only:=true']
            self._processes.start(_PAGE, page, dict(os.environ))
        name = self.bag.with_name(self._settings.scenario)
        self._start('bag_recorder', ['-p', f'output:={name}'])
        self._start('soliton_analyser', _ALL_FRAMES)
        self._start('edge_actuator', [])
        self._page = self._page and self._serve_page()
        # The simulator waits for its subscribers, so that the analyser receives the first frames.
        self._start('simulator', ['-p', f'subscribers:={len(_NODES) - 1 + self._page}'])
        # The import takes seconds. Use a thread, so that nodes and signals are not delayed.
        importing = threading.Thread(target=import_module, args=(_REPORT,), daemon=True)
        importing.start()
        self._wait_until(
            lambda: self._ready() and not importing.is_alive(), START_LIMIT, self._unready
        )
        self._report = import_module(_REPORT)

    def _serve_page(self) -> bool:
        """Print the address of the live page, or why it has failed; return whether it runs."""
        deadline = time.monotonic() + START_LIMIT
        try:
            while not self._processes.wait(_PAGE, _QUIET) and time.monotonic() < deadline:
                self._interrupted()
                address = page_address(self._processes.output(_PAGE))
                if address:
                    _print(f'Watch the chain while it runs:\n  {address}')
                    if has_display():
                        webbrowser.open(address)
                    return True
        except RuntimeError:
            pass
        output = self._processes.output(_PAGE).splitlines()
        _print(f'The page is not available: {output[-1] if output else "it did not start"}')
        self._processes.stop([_PAGE])
        return False

    def _start(self, node: str, arguments: list[str]) -> None:
        common = ['--params-file', str(self._configuration)]
        self._processes.start(node, [*common, *arguments], dict(os.environ))

    def _ready(self) -> bool:
        received = set(self._observer.figures('bag_recorder').get('topics received', '').split())
        # Accept warnings of the simulator and the recorder. They count missed deadlines and lost
        # messages, which the summary states.
        return (
            all(self._observer.well(node) for node in ('soliton_analyser', 'edge_actuator'))
            and received >= _RECORDED_TOPICS
            and self._observer.nudge_publisher.get_subscription_count() == 2
            and self._observer.edge_publisher.get_subscription_count() > 0
            and self._observer.figures('edge_actuator').get('subscribers') == '2'
            and self._observer.informed
        )

    def _unready(self) -> str:
        known = {node: report.message for node, report in self._observer.reports.items()}
        reports = '; '.join(f'{node}: {known.get(node, "no report")}' for node in _NODES)
        return f'the nodes were not ready after {START_LIMIT:g} s: {reports}'

    def _drive(self) -> None:
        settings = self._settings
        speed, cycles = settings.nudge, settings.burst_cycles
        if cycles:
            frequency = settings.burst_frequency
            _print(f'Driving rotor 0 with {cycles:g} periods at {frequency:g} rad/s.')
            self._observer.send_burst()
        elif speed:
            _print(f'Nudging the edge: a kick of {speed:g} rad/s along the zero mode.')
            self._observer.nudge_publisher.publish(Float64(data=speed))
        else:
            _print('The soliton starts by itself.')

    def _watch(self) -> None:
        """Show the soliton until the experiment ends.

        If the parameter `end` is 'time', the experiment ends after the time `time_limit`. If `end`
        is 'return', the experiment ends when the soliton has crossed the chain and has returned to
        rotor 0. If this takes longer than `time_limit`, the method raises RuntimeError.
        """
        settings = self._settings
        timed = settings.end == 'time'
        if settings.nudge or settings.burst_cycles:
            # On a busy machine, a state that arrives after the command may be older than the
            # command.
            start = max(self._observer.stamp, self._observer.get_clock().now().nanoseconds)
        else:
            start = next(iter(self._observer.states))
        line, trip = ChainLine(self._observer), RoundTrip(self._observer)

        def ended() -> bool:
            returned = trip.ended()
            if trip.remark:
                line.show(self._observer.rotors_of_walls, trip.remark)
            passed = (self._observer.stamp - start) / SECOND
            return passed >= settings.time_limit if timed else returned

        self._wait_until(ended, math.inf if timed else settings.time_limit, trip.missing)
        line.end(
            f'{settings.time_limit:g} s of motion are recorded.'
            if timed
            else 'The soliton crossed the chain, was reflected at the far edge and came back.'
        )

    def _finish(self) -> Mapping[str, str]:
        """Wait for a report of the simulator, stop the nodes, and return the reported values."""
        self._observer.reports.pop('simulator', None)
        self._wait_until(
            lambda: 'simulator' in self._observer.reports,
            _REPORT_LIMIT,
            lambda: f'no report of the simulator for {_REPORT_LIMIT:g} s; see its log',
        )
        pacing = self._observer.figures('simulator')
        # Stop the simulator first, so that every analysed frame is recorded.
        codes = self._processes.stop(['simulator'])
        codes |= self._processes.stop([node for node in _NODES if node != 'simulator'])
        wrong = {node: code for node, code in codes.items() if code}
        if wrong:
            raise RuntimeError(f'nodes did not stop cleanly, exit codes {wrong}')
        return pacing

    def _start_replay(self) -> None:
        _print(f'Replaying {self.bag} into a second analyser, and drawing the motion.')
        self._observer.forget()
        self._start('soliton_analyser', _ALL_FRAMES)
        topics_played = (interfaces.CHAIN, interfaces.DELIVERED_IMPULSES, interfaces.JOINT_STATES)
        topics = [topic.name for topic in topics_played]
        given = [f'bag:={self.bag}', f'topics:=[{",".join(topics)}]', 'lockstep:=true']
        given += [f'subscriber_timeout:={START_LIMIT}', 'start_paused:=true']
        self._start('bag_player', [word for each in given for word in ('-p', each)])

    def _draw(self) -> Any:
        with interruptible(self._stopping):
            recorded = self._report.read_run(self.bag)
            self._report.draw(recorded, self._output)
        return recorded

    def _replay(self) -> dict[int, tuple[float, ...]]:
        """Play the bag to another analyser, and return its states.

        The keys are stamps [ns]. The values are site coordinates of solitons [rotor spacings].
        """
        service, name = service_type('Resume'), 'bag_player/resume'
        resuming = self._observer.create_client(service, name, qos_profile=SERVICE_QOS)
        self._wait_until(
            lambda: self._replay_connected() and resuming.service_is_ready(),
            START_LIMIT,
            lambda: f'analyser and player not connected after {START_LIMIT:g} s; see their logs',
        )
        resuming.call_async(service.Request())
        line = ProgressLine('replaying', 0)

        def played() -> bool:
            line.total = float(self._observer.figures('bag_player').get('messages', 0))
            line.show(len(self._observer.states))
            return self._processes.wait('bag_player', 0)

        spin_until(self._executor, played, math.inf, self._interrupted)
        self._settle()
        self._processes.stop()
        line.end(f'Replayed {len(self._observer.states)} frames.')
        return dict(self._observer.states)

    def _replay_connected(self) -> bool:
        figures = self._observer.figures('soliton_analyser')
        wanted = str(2 + self._page)
        return figures.get('subscribers') == wanted and figures.get('frames') == '0'

    def _settle(self) -> None:
        seen = -1

        def more() -> bool:
            return len(self._observer.states) > seen

        while more():
            seen = len(self._observer.states)
            spin_until(self._executor, more, _QUIET, self._interrupted)

    def _summary(
        self, recorded: Any, replayed: dict[int, tuple[float, ...]], pacing: Mapping[str, str]
    ) -> dict[str, Any]:
        difference = self._report.largest_difference(recorded.states, replayed)
        summary = {
            'scenario': self._settings.scenario,
            **self._report.summarise(recorded),
            'replayed_messages': len(replayed),
            'frames_missing_in_replay': len(recorded.states.keys() - replayed.keys()),
            'largest_replay_difference_rotors': difference,
            'missed_deadlines': int(pacing['missed deadlines']),
            'energy_drift': float(pacing['energy drift']),
        }
        text = json.dumps(summary, indent=2) + '\n'
        (self._output / 'summary.json').write_text(text, encoding='utf-8')
        return summary

    def _wait_until(
        self, condition: Callable[[], bool], seconds: float, failure: Callable[[], str]
    ) -> None:
        def give_up() -> bool:
            self._processes.check()
            return self._interrupted()

        if not spin_until(self._executor, condition, seconds, give_up):
            raise RuntimeError(failure())

    def _interrupted(self) -> bool:
        if self._stopping.is_set():
            raise KeyboardInterrupt
        return False
