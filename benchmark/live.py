# SPDX-License-Identifier: Apache-2.0
"""Cost of the live page: processor time and memory of server, browser and simulator.

Simulator, other nodes and live_view run as processes, and headless Chromium shows the page. The
delay of a nudge is the time from the click on its button to the first picture in which a rotor has
moved. Clients of the stream simulate many browsers on other machines; with --pages, pages of
Chromium do. A socket that is never read simulates a stalled browser.
"""

from __future__ import annotations

import os
import shutil
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from itertools import product
from pathlib import Path
from typing import Any

import processes
import rclpy
from comparison import Figure, Part, parse, parser, tracked, write
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.runtime import interfaces

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
SETTLING = 3.0
LONGEST_WAIT = 60.0
NUDGES = 21
MOVED = 1e-3
PORT = 18_777
PARTS = ('pictures', 'delay', 'crowd', 'silent', 'open')
ASK = (
    'GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n'
    'Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
    'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n'
)
NODES = ('edge_actuator', 'soliton_analyser', 'soliton_steering')
LATENCY = """async ([id, moved]) => {
  const before = [...live.shown.angles];
  const begun = performance.now();
  document.getElementById(id).click();
  while (performance.now() - begun < 5000) {
    await new Promise(requestAnimationFrame);
    if (live.shown.angles.some((a, n) => Math.abs(a - before[n]) > moved)) break;
  }
  return performance.now() - begun;
}"""


def main() -> None:
    options = parser(__doc__)
    for name, about in (
        ('--seconds', 'duration of each measurement (20)'),
        ('--minutes', 'time during which the page is open (5)'),
    ):
        options.add_argument(name, type=float, help=about)
    about = 'simulate many browsers by complete pages'
    options.add_argument('--pages', action='store_true', help=about)
    options.add_argument(
        '--only', choices=PARTS, nargs='+', default=PARTS, help='parts to measure'
    )
    usual = {'seconds': (3.0, 20.0), 'minutes': (0.1, 5.0), 'nudges': (5, NUDGES)}
    arguments = parse(options, rounds=(1, 3), browsers=(2, 10), **usual)
    seconds, rounds = arguments.seconds, arguments.rounds
    figures: list[Figure] = []
    drawing = {'pictures', 'delay', 'open'} | ({'crowd'} if arguments.pages else set())
    with chromium() if drawing & set(arguments.only) else nullcontext() as browser:
        pages = browser if arguments.pages else None
        parts = {
            'pictures': lambda: [
                *pictures(browser, 40, 60.0, seconds, rounds),
                *pictures(browser, 1000, 30.0, seconds, rounds),
            ],
            'delay': lambda: delay(browser, arguments.nudges),
            'crowd': lambda: crowd(arguments.browsers, seconds, rounds, pages),
            'silent': lambda: silent_reader(seconds),
            'open': lambda: open_long(browser, 60 * arguments.minutes),
        }
        for name in arguments.only:
            figures += parts[name]()
    write(Part('live', figures=figures), arguments.output)


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a headless browser."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        path = None
    if path is None:
        sys.exit('live: Chromium or Playwright is missing; install both and start again')
    with sync_playwright() as playwright:
        options = ['--no-sandbox', '--enable-precise-memory-info']
        browser = playwright.chromium.launch(executable_path=path, args=options)
        yield browser
        browser.close()


class Reports(dict[str, dict[str, str]]):
    """Last diagnostics of each node, by the names of the node and of the figure."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        interfaces.DIAGNOSTICS.subscribe(node, self._note)

    def _note(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = {pair.key: pair.value for pair in status.values}
            self[status.name.partition(':')[0]] = figures


class Scene:
    """Simulator with all nodes and the page, on a separate domain."""

    def __init__(
        self, stack: ExitStack, settings: Mapping[str, Any], rate: float, nodes: Sequence[str]
    ) -> None:
        stack.enter_context(processes.own_domain())
        self.node = Node('benchmark')
        stack.callback(self.node.destroy_node)
        self.reports = Reports(self.node)
        stack.enter_context(processes.running(processes.node_command('simulator', settings)))
        for name in nodes:
            stack.enter_context(processes.running(processes.node_command(name, {})))
        page = processes.node_command('live_view', {'port': PORT, 'frame_rate': rate})
        self.server = stack.enter_context(processes.running(page)).pid
        self.spin(lambda: {'simulator', 'live_view', *nodes} <= set(self.reports))

    def spin(self, condition: Any, seconds: float = LONGEST_WAIT) -> None:
        """Receive diagnostics until a condition holds."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def fresh(self, name: str, figure: str) -> float:
        """Return a figure from the next report of a node."""
        self.reports.pop(name, None)
        self.spin(lambda: name in self.reports)
        return float(self.reports[name][figure])

    def reset(self) -> None:
        """Put the chain to rest."""
        client = self.node.create_client(Reset, 'simulator/reset')
        self.spin(client.service_is_ready)
        done = client.call_async(Reset.Request(state=Reset.Request.LEFT_LEANING))
        self.spin(done.done)
        self.node.destroy_client(client)


@contextmanager
def scene(
    rotors: int = 40, hertz: float = 500.0, rate: float = 60.0, nodes: Sequence[str] = NODES
) -> Iterator[Scene]:
    """Yield a chain with a soliton at rest in the middle, and the page."""
    settings = {
        'chain.number_of_rotors': rotors,
        'publish_rate': hertz,
        'initial_state': 'soliton',
        'initial_position': rotors / 2 - 0.5,
    }
    with ExitStack() as stack:
        yield Scene(stack, settings, rate, nodes)


def visit(browser: Any) -> Any:
    """Open the page and return it when it has drawn ten pictures."""
    page = browser.new_context(viewport={'width': 1400, 'height': 1000}).new_page()
    page.goto(f'http://127.0.0.1:{PORT}/', timeout=120_000)
    page.wait_for_function('() => window.live && live.drawn > 10', timeout=120_000)
    return page


def pictures(browser: Any, rotors: int, rate: float, seconds: float, rounds: int) -> list[Figure]:
    """Return the load of the server, pictures per second, and the time of the page per picture."""
    shares, drawn, costs = [], [], []
    work = f'{rotors} rotors'
    with scene(rotors, 100.0 if rotors > 100 else 500.0, rate) as stage:
        page = visit(browser)
        time.sleep(SETTLING)
        for _ in tracked(range(rounds), work, '{} rounds'):
            before, count, begun = now(stage, page)
            time.sleep(seconds)
            after, more, ended = now(stage, page)
            shares.append(100 * (after - before) / (ended - begun))
            drawn.append((more - count) / (ended - begun))
            costs.append(1e-3 * statistics.median(page.evaluate('live.costs')))
        page.context.close()
    most = '15' if rotors == 40 else '30'
    return [
        Figure(f'server, {work} at {rate:g} pictures/s', '% of a core', shares, f'under {most} %'),
        Figure(f'pictures per second, {work}', '1/s', drawn, f'{rate:g}'),
        Figure(f'time of the page for a picture, {work}', 's', costs, 'under 8 ms'),
    ]


def now(stage: Scene, page: Any) -> tuple[float, float, float]:
    """Return the processor time of the server [s], the number of pictures, and the time [s]."""
    return (
        processes.processor_time(stage.server),
        float(page.evaluate('live.drawn')),
        time.monotonic(),
    )


def delay(browser: Any, nudges: int) -> list[Figure]:
    """Return the times from a click on nudge to the first picture with a moved rotor."""
    delays = []
    with scene() as stage:
        page = visit(browser)
        for _ in tracked(range(nudges), 'nudges'):
            stage.reset()
            time.sleep(0.5)
            delays.append(1e-3 * page.evaluate(LATENCY, ['live-nudge', MOVED]))
        page.context.close()
    what, median = 'from a click on nudge to the canvas, median', statistics.median(delays)
    return [
        Figure(what, 's', [median], 'within 100 ms'),
        Figure('the same, the slowest', 's', [max(delays)]),
    ]


def crowd(browsers: int, seconds: float, rounds: int, drawing: Any) -> list[Figure]:
    """Return the effect of many browsers on a simulator at 1000 Hz and its recorder.

    The browsers are pages of the browser `drawing`, or only streams if `drawing` is None. Runs
    with and without browsers alternate, because the load of the machine changes.
    """
    crowds = (0, browsers)
    missed, lost, shares = ({visitors: [] for visitors in crowds} for _ in range(3))
    with scene(hertz=1000.0) as stage, ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        command = processes.node_command('bag_recorder', {'output': Path(folder, 'bag')})
        stack.enter_context(processes.running(command))
        stage.spin(lambda: 'bag_recorder' in stage.reports)
        for _, visitors in product(range(rounds), crowds):
            with watching(visitors, drawing):
                time.sleep(SETTLING)
                before = [stage.fresh(*figure) for figure in COUNTED]
                spent, begun = processes.processor_time(stage.server), time.monotonic()
                time.sleep(seconds)
                after = [stage.fresh(*figure) for figure in COUNTED]
                span = time.monotonic() - begun
                share = (processes.processor_time(stage.server) - spent) / span
            missed[visitors].append((after[0] - before[0]) / span)
            lost[visitors].append(after[1] - before[1])
            shares[visitors].append(100 * share)
    names = {0: 'none', browsers: f'{browsers} pages' if drawing else f'{browsers}'}
    figures = []
    for visitors, name in names.items():
        work, goal = f'at 1000 Hz, {name} watching', 'as without' if visitors else ''
        figures += [
            Figure(f'missed deadlines {work}', '1/s', missed[visitors], goal),
            Figure(f'messages lost {work}', '', lost[visitors], '0'),
            Figure(f'server {work}', '% of a core', shares[visitors]),
        ]
    return figures


@contextmanager
def watching(visitors: int, drawing: Any) -> Iterator[None]:
    """Open a number of pages of a browser, or only streams if `drawing` is None."""
    if drawing is None:
        watchers = Path(__file__).with_name('live_watchers.py')
        with processes.running(processes.program_command(watchers, PORT, visitors)):
            yield
        return
    pages = [visit(drawing) for _ in range(visitors)]
    before = [page.evaluate('live.drawn') for page in pages]
    begun = time.monotonic()
    yield
    spent = time.monotonic() - begun
    drawn = [
        (page.evaluate('live.drawn') - count) / spent
        for page, count in zip(pages, before, strict=True)
    ]
    if pages:
        print(f'{visitors} pages drew {min(drawn):.0f} to {max(drawn):.0f} pictures a second')
    for page in pages:
        page.context.close()


COUNTED = (('simulator', 'missed deadlines'), ('bag_recorder', 'lost messages'))


def silent_reader(seconds: float) -> list[Figure]:
    """Return the memory growth of the server while a browser reads nothing."""
    with scene(nodes=()) as stage:
        time.sleep(SETTLING)
        with socket.create_connection(('127.0.0.1', PORT)) as reader:
            reader.sendall(ASK.format(port=PORT).encode())
            time.sleep(SETTLING)
            before = memory(stage.server)
            time.sleep(seconds)
            grown = memory(stage.server) - before
    what = f'memory for a browser that reads nothing for {seconds:g} s'
    return [Figure(what, 'MB', [grown], 'not growing')]


def open_long(browser: Any, seconds: float) -> list[Figure]:
    """Return the memory growth of server and page while the page is open."""
    with scene() as stage:
        page = visit(browser)
        # The plots have their full length after 20 s.
        time.sleep(min(25.0, seconds))
        before = memory(stage.server), heap(page)
        progress = ProgressLine('open', seconds)
        begun = time.monotonic()
        while time.monotonic() - begun < seconds:
            progress.show(time.monotonic() - begun)
            time.sleep(1.0)
        after = memory(stage.server), heap(page)
        progress.end(f'open for {seconds / 60:.1f} minutes')
        page.context.close()
    span = f'{seconds / 60:g} minutes open'
    return [
        Figure(f'growth of the server, {span}', 'MB', [after[0] - before[0]], 'flat'),
        Figure(f'growth of the page, {span}', 'MB', [after[1] - before[1]], 'flat'),
    ]


def memory(process: int) -> float:
    """Return the memory of a process [MB]."""
    pages = int(Path(f'/proc/{process}/statm').read_text(encoding='ascii').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def heap(page: Any) -> float:
    """Return the memory of the script of a page after garbage collection [MB]."""
    session = page.context.new_cdp_session(page)
    session.send('HeapProfiler.collectGarbage')
    return float(page.evaluate('performance.memory.usedJSHeapSize')) / 1e6


if __name__ == '__main__':
    main()
