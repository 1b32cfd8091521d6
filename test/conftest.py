# SPDX-License-Identifier: Apache-2.0
"""How the tests are run: repeatably, side by side, and with a plain last word.

Hypothesis takes the same examples in every run, unless told `--hypothesis-profile`.
"""

from __future__ import annotations

import gc
import os
import signal
from collections import Counter, defaultdict
from itertools import chain, groupby
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

HERE = Path(__file__).parent

# Before numpy is imported: side by side each worker has a core, and threads of linear algebra
# would only wait for one another.
if 'PYTEST_XDIST_WORKER' in os.environ:
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

settings.register_profile(
    'repeatable', deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile(
    'searching', parent=settings.get_profile('repeatable'), derandomize=False, max_examples=2000
)
settings.load_profile('repeatable')


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--benchmarks', action='store_true', help='run parts of the benchmark too')


def pytest_collection() -> None:
    """What is imported stays: no search for garbage looks through it, then or later."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Each test has Python's own handlers of signals, and so have the programs that it starts.

    A program that an earlier test ran in this process leaves its own; where the tests were started
    in the background of a script, a shell has SIGINT ignored, and who is started inherits that.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """What a module has kept for its tests goes with them: garbage would be searched for in it."""
    module = getattr(item, 'module', None)
    if module is None or (nextitem is not None and nextitem.path == item.path):
        return
    for kept in vars(module).values():
        if hasattr(kept, 'cache_clear') and kept.__module__ == module.__name__:
            kept.cache_clear()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Side by side, what takes long begins, and nodes, which wait, run among what computes.

    A worker begins with an even share of the list; later it takes from the ends of others'.
    """
    if not hasattr(config, 'workerinput'):
        return
    kinds: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        parts = item.path.relative_to(HERE).parts
        apart = (part for part in ('in_browser', 'soliton_steering') if part in parts)
        kinds[next(apart, parts[0])].append(item)
    workers = config.workerinput['workercount']
    shares: list[list[pytest.Item]] = [[] for _ in range(workers)]
    # Who waited for moves of a soliton at the end would wait alone.
    longest = kinds.pop('system', []) + kinds.pop('soliton_steering', [])
    for number, item in enumerate(longest):
        shares[number % workers].append(item)
    # The tests of a benchmark share its one run, and those in a browser its one page.
    together = groupby(kinds.pop('benchmark', []), lambda item: item.path)
    for number, (_, group) in enumerate(together):
        shares[number % workers].extend(group)
    shares[-1].extend(kinds.pop('in_browser', []))
    places = {
        path: number / len(members)
        for members in kinds.values()
        for number, path in reversed([(n, item.path) for n, item in enumerate(members)])
    }
    rest = sorted(chain(*kinds.values()), key=lambda item: places[item.path])
    left = len(items)
    for number, share in enumerate(shares):
        size = left // (workers - number) - len(share)
        left -= len(share) + max(size, 0)
        share += rest[: max(size, 0)]
        del rest[: max(size, 0)]
    items[:] = [*chain(*shares), *rest]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reasons = Counter(
        report.longrepr[2].removeprefix('Skipped: ')
        for report in terminalreporter.stats.get('skipped', [])
        if isinstance(report.longrepr, tuple)
    )
    for reason, number in reasons.most_common():
        tests = '1 test was' if number == 1 else f'{number} tests were'
        terminalreporter.write_line(f'{tests} skipped: {reason}')


def pytest_unconfigure(config: pytest.Config) -> None:
    terminal = config.pluginmanager.get_plugin('terminalreporter')
    if terminal is None or hasattr(config, 'workerinput') or config.option.collectonly:
        return
    count = {kind: len(reports) for kind, reports in terminal.stats.items()}
    failed = count.get('failed', 0) + count.get('error', 0)
    skipped = count.get('skipped', 0)
    terminal.write_line(f'{count.get("passed", 0)} passed, {failed} failed, {skipped} skipped')
