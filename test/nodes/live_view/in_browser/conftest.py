# SPDX-License-Identifier: Apache-2.0
"""One graph, one browser and one page for all tests of the page."""

from __future__ import annotations

import itertools
import math
import os
import shutil
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import domain_coordinator
import pytest

sys.path.append(str(Path(__file__).parent))

from live_stage import PLACE, SIMULATED, Browser, Stage, Visit, until
from std_srvs.srv import Trigger

from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.live_view.node import LiveView
from soliton_linkage_nodes.runtime import diagnostics, interfaces
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
BAGS = Path(__file__).parents[4] / 'bags'
COMMANDS = (interfaces.NUDGE, interfaces.EDGE_COMMAND, interfaces.TILT)
FAILED = pytest.StashKey[bool]()
_domains = itertools.count(101 + int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:]), 20)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.session.stash[FAILED] = True
    return report


@pytest.fixture(scope='package')
def browser() -> Iterator[Browser]:
    pytest.importorskip('nicegui', reason='NiceGUI is not installed')
    sync = pytest.importorskip('playwright.sync_api', reason='Playwright is not installed')
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f'no browser for the page: none of {", ".join(BROWSERS)} is installed')
    with sync.sync_playwright() as playwright:
        launch = partial(
            playwright.chromium.launch,
            executable_path=path,
            args=['--no-sandbox', '--disable-gpu'],
        )
        opened = Browser(launch)
        yield opened
        opened.close()


@pytest.fixture(scope='package')
def fresh_nicegui(browser: Browser) -> Iterator[None]:
    """Let a page begin though an earlier one has been served by this process."""
    from nicegui import Client
    from nicegui.testing.general import nicegui_reset_globals

    with nicegui_reset_globals():
        yield
        # Else it has Python forget the modules of pages, which others have imported.
        Client.page_routes.clear()


@pytest.fixture(scope='package')
def domains() -> Iterator[Callable[[], int]]:
    """Domains that nobody else is on."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(domain_coordinator.domain_id(lambda: next(_domains)))


@pytest.fixture(scope='package')
def stage(
    fresh_nicegui: None, domains: Callable[[], int], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Stage]:
    made = Stage(domains(), tmp_path_factory.mktemp('live'))
    yield made
    made.close()


@pytest.fixture(scope='package')
def view(stage: Stage) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnostics, '_PERIOD', 0.2)
        stage.start(Simulator, SIMULATED)
        stage.start(SolitonAnalyser)
        for node in (EdgeActuator, SolitonSteering):
            stage.start(node, {'state_timeout': 5.0})
    for topic in (*COMMANDS, interfaces.LAST_KICK):
        stage.listen(topic)
    folders = [str(stage.folder / 'bags'), str(BAGS)]
    made = stage.start(LiveView, {'port': 0, 'bag_folders': folders, 'frame_rate': 10.0})
    chain = made.finder.chains['/'].model
    until(lambda: chain.numbers.get('walls') == 1, 'the soliton')
    commands = made.commands('/')
    until(lambda: all(commands.listeners(t.name) == 2 for t in COMMANDS), 'who hears the page')
    return made


@pytest.fixture(scope='package')
def open_page(browser: Browser, view: Any) -> Iterator[Callable[..., Visit]]:
    visits: list[Visit] = []

    def visit(address: str = '', **options: Any) -> Visit:
        visits.append(Visit(browser, address or view.address, **options))
        return visits[-1]

    yield visit
    for each in visits:
        each.close()


@pytest.fixture(scope='package')
def shared(open_page: Callable[..., Visit]) -> Visit:
    return open_page()


@pytest.fixture
def visit(
    shared: Visit,
    stage: Stage,
    browser: Browser,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> Iterator[Visit]:
    """The page of all tests, which shows all of its chain and says nothing in the console."""
    # That of the programs which the page starts.
    monkeypatch.setenv('ROS_DOMAIN_ID', str(stage.domain))
    if request.session.stash.get(FAILED, False):
        # A browser that hangs would fail all other tests.
        request.session.stash[FAILED] = False
        browser.reopen()
        shared.open(browser)
    shared.page.bring_to_front()
    if shared.js('live.watched') != '/':
        # What an earlier test left that failed.
        shared.begin()
    shared.js('live.view.all()')
    yield shared
    console, shared.console = shared.console, []
    assert console == []


@pytest.fixture
def at_rest(view: Any, visit: Visit, stage: Stage) -> Visit:
    """The same, with the chain at rest and its soliton in its place."""
    visit.tab('Drive')
    stage.call('soliton_steering/release', Trigger, Trigger.Request())
    assert stage.call('simulator/reset', Reset, Reset.Request()).success
    model, reports = view.finder.chains['/'].model, view.finder.reports
    until(lambda: abs(model.numbers.get('rotor', math.nan) - PLACE) < 0.1, 'the reset')
    reports.pop('/soliton_steering', None)
    until(
        lambda: (
            '/soliton_steering' in reports
            and abs(float(reports['/soliton_steering'][1].figures['rotor']) - PLACE) < 0.1
        ),
        'the steering to see the soliton',
    )
    return visit
