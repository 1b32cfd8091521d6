# SPDX-License-Identifier: Apache-2.0
import itertools
import logging
import math
import shutil
import sys
from collections.abc import Generator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import domain_coordinator
import pytest

sys.path.append(str(Path(__file__).parent))

from live_stage import PLACE, SIMULATED, Browser, Stage, SteeredClock, Visit
from programs import until
from std_srvs.srv import SetBool, Trigger

from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.live_view.node import LiveView
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
BAGS = Path(__file__).parents[4] / 'bags'
COMMANDS = (interfaces.NUDGE, interfaces.EDGE_COMMAND, interfaces.TILT)
OBSERVED, STEPPED = 200, 50
FAILED = pytest.StashKey[bool]()
# Domains above 101 use ports that the system gives to any socket.
_domains = itertools.cycle(range(81, 102))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.session.stash[FAILED] = True
    return report


@pytest.fixture(scope='package')
def browser():
    pytest.importorskip('nicegui', reason='needs NiceGUI: pip install nicegui')
    sync = pytest.importorskip(
        'playwright.sync_api', reason='needs Playwright: pip install playwright'
    )
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip('needs a browser: apt install chromium')
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
def fresh_nicegui(browser):
    """Reset NiceGUI, which may have served an earlier page in this process."""
    from nicegui import Client
    from nicegui.testing.general import nicegui_reset_globals

    with nicegui_reset_globals():
        yield
        # Otherwise NiceGUI unloads the modules of pages, which other tests have imported.
        Client.page_routes.clear()


@pytest.fixture(scope='package')
def domains():
    with ExitStack() as stack:
        yield lambda: stack.enter_context(domain_coordinator.domain_id(lambda: next(_domains)))


@pytest.fixture(scope='package')
def stage(fresh_nicegui, domains, tmp_path_factory):
    made = Stage(domains(), tmp_path_factory.mktemp('live'))
    yield made
    made.close()


@pytest.fixture(scope='package')
def live_view(stage):
    folders = [str(stage.folder / 'bags'), str(BAGS)]
    # NiceGUI starts first, because its start calls gc.get_objects, which breaks a tuple that
    # another thread is building (SystemError).
    made: LiveView = stage.start(LiveView, {'port': 0, 'bag_folders': folders, 'frame_rate': 5.0})
    simulator = stage.start(Simulator, SIMULATED)
    stage.start(SolitonAnalyser)
    stage.start(EdgeActuator, {'state_timeout': 60.0})
    SteeredClock(stage, simulator, stage.start(SolitonSteering, {'state_timeout': 60.0}))
    for topic in (*COMMANDS, interfaces.LAST_KICK, interfaces.ROTOR_TORQUES):
        stage.subscribe(topic)
    chain = made.view.chains['/'].model
    until(lambda: chain.numbers.get('walls') == 1, 'the soliton', lambda: _seen(made.view))
    commands = made.view.commands('/')
    until(lambda: all(commands.subscribers(t.name) == 2 for t in COMMANDS), 'the subscribers')
    return made


def _seen(view: View) -> Any:
    model = view.chains['/'].model
    return model.numbers, model.state_age, model.error, model.angles


@pytest.fixture(scope='package')
def view(live_view):
    return live_view.view


@pytest.fixture(scope='package')
def open_page(browser, live_view):
    visits: list[Visit] = []

    def visit(address: str = '', **options: Any) -> Visit:
        visits.append(Visit(browser, address or live_view.address, **options))
        return visits[-1]

    yield visit
    for each in visits:
        each.close()


@pytest.fixture(scope='package')
def shared(open_page):
    return open_page()


@pytest.fixture
def visit(shared, stage, browser, monkeypatch, request, caplog):
    """Shared page, which shows its whole chain; neither page nor server logs an error."""
    # For the programs that the page starts.
    monkeypatch.setenv('ROS_DOMAIN_ID', str(stage.domain))
    if request.session.stash.get(FAILED, False):
        # A browser that hangs would fail all further tests.
        request.session.stash[FAILED] = False
        browser.reopen()
        shared.open(browser)
    shared.page.bring_to_front()
    if shared.js('live.watched') != '/':
        # An earlier test failed, and its replay may still run.
        shared.load()
        shared.js('live.watch("/")')
        shared.wait('live.watched === "/" && live.shown.rotors === 12')
    shared.js('live.view.all()')
    shared.js('live.answers.log = []')
    yield shared
    console, shared.console = shared.console, []
    assert console == []
    logged = [each for each in caplog.get_records('call') if each.name == 'nicegui']
    assert [each.getMessage() for each in logged if each.levelno >= logging.ERROR] == []


@pytest.fixture
def at_rest(view, visit, stage):
    """Shared page, with the chain and its soliton at rest."""
    visit.tab('Drive')
    stage.call(Trigger, 'soliton_steering/release')
    assert stage.call(Reset, 'simulator/reset').success
    # The observer of the steering takes the reset for a fast motion until it has forgotten the
    # frames before the reset.
    stage.call(SetBool, 'simulator/pause', data=True)
    for _ in range(OBSERVED // STEPPED):
        assert stage.call(Step, 'simulator/step', periods=STEPPED).success
    stage.call(SetBool, 'simulator/pause', data=False)
    model, reports = view.chains['/'].model, view.finder.reports
    # The zero mode depends on the angles of one frame only, the position also on earlier frames.
    until(
        lambda: abs(model.numbers.get('zero_mode_rotor', math.nan) - PLACE) < 0.1,
        'the reset',
        lambda: _seen(view),
    )
    reports.pop('/soliton_steering', None)
    until(
        lambda: (
            '/soliton_steering' in reports
            and abs(float(reports['/soliton_steering'][1].figures['rotor']) - PLACE) < 0.1
        ),
        'the steering to see the soliton',
        lambda: (reports, _seen(view)),
    )
    return visit
