# SPDX-License-Identifier: Apache-2.0
"""Configuration of the tests: repeatable, in parallel, with a summary.

Hypothesis uses the same examples in every run, unless `--hypothesis-profile` is given.
"""

import gc
import os
import signal
from collections import Counter, defaultdict
from itertools import chain, groupby
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

HERE = Path(__file__).parent

# This must precede the import of numpy. The matrices are small, and further threads of linear
# algebra would wait for each other.
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
    """Exclude imported modules from garbage collection."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Restore Python's signal handlers before each test.

    A program that an earlier test ran in this process may have changed them. A shell ignores
    SIGINT in background jobs, and child processes inherit that.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Clear the caches of a module after its last test, to relieve garbage collection."""
    module = getattr(item, 'module', None)
    if module is None or (nextitem is not None and nextitem.path == item.path):
        return
    for kept in vars(module).values():
        if hasattr(kept, 'cache_clear') and kept.__module__ == module.__name__:
            kept.cache_clear()


_MOVES = ('soliton_steering', 'test_move_soliton.py')
"""Folder and file of tests that wait until a soliton has moved."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order parallel tests: long ones first, tests of nodes (which wait) among computations.

    Each worker starts with an even share of the list and later takes tests from other workers.
    """
    if not hasattr(config, 'workerinput'):
        return
    kinds: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        parts = item.path.relative_to(HERE).parts
        apart = ('in_browser', *_MOVES)
        kinds[next((part for part in apart if part in parts), parts[0])].append(item)
    workers = config.workerinput['workercount']
    shares: list[list[pytest.Item]] = [[] for _ in range(workers)]
    # At the end, the other workers would be idle during the moves of a soliton.
    longest = [item for kind in ('system', *_MOVES) for item in kinds.pop(kind, [])]
    for number, item in enumerate(longest):
        shares[number % workers].append(item)
    # The tests of a benchmark share one run, and the tests in a browser share one page.
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
