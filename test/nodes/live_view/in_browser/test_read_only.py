# SPDX-License-Identifier: Apache-2.0
import re
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from live_stage import Rig, Stage, Visit
from programs import Program, until

BAGS = Path(__file__).parents[4] / 'bags'
PARAMETERS = ('host:=0.0.0.0', 'port:=0', 'read_only:=true', f'bag_folders:=[{BAGS}]')


def address_of(served: Program) -> str:
    """Return the address by which this machine reaches the page."""

    def printed() -> re.Match[str] | None:
        return re.search(r'open http://.*:(\d+)/(.*)', '\n'.join(served.said))

    found = until(printed, 'the address')
    return f'http://127.0.0.1:{found[1]}/{found[2]}'


@pytest.fixture(scope='module')
def domain(domains):
    return domains()


@pytest.fixture(scope='module')
def served(domain, tmp_path_factory):
    pytest.importorskip('nicegui', reason='needs NiceGUI: pip install nicegui')
    arguments = [part for each in PARAMETERS for part in ('-p', each)]
    log = tmp_path_factory.mktemp('read_only') / 'log'
    made = Program('live_view', ['--ros-args', *arguments], domain, log)
    yield made
    try:
        assert made.stop() == 0
    finally:
        made.process.kill()
    assert 'Traceback' not in ''.join(made.said)


def request(address: str, **headers: str) -> tuple[int, str]:
    wanted = urllib.request.Request(address, headers=headers)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        with opener.open(wanted, timeout=120) as answer:
            return int(answer.status), answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_a_page_for_other_machines_requires_the_printed_token(served):
    here, _, token = address_of(served).partition('?token=')
    assert len(token) >= 32
    status, page = request(f'{here}?token={token}')
    assert status == 200
    assert 'Soliton chain, live' in page
    for path in ('', 'live/live.js', f'?token={token[:-1]}', '_nicegui_ws/socket.io/?EIO=4'):
        status, reason = request(f'{here}{path}')
        assert status == 403, path
        assert 'the token is missing or wrong' in reason
    status, reason = request(f'{here}?token={token}', Origin='http://evil.example')
    assert status == 403
    assert 'is not this page' in reason
    assert '\n'.join(served.said).count(token) == 1


def test_a_read_only_page_sends_no_commands(served, browser, domain, tmp_path):
    stage = Stage(domain, tmp_path)
    rig = Rig(stage, '/')
    rig.go(7)
    visit = Visit(browser, address_of(served))
    assert 'token' not in visit.page.url
    visit.wait('live.shown && live.shown.rotors === 7')
    assert visit.page.locator('.live-badge').inner_text() == 'read-only'
    for tab in ('Drive', 'Run', 'Bags'):
        visit.tab(tab)
        visit.panel_has_text('this page is read-only')
        buttons = visit.page.locator('.q-tab-panel:visible fieldset button')
        # One evaluation, because the page may replace the buttons meanwhile.
        disabled = buttons.evaluate_all('all => all.map((one) => one.matches(":disabled"))')
        assert len(disabled) > 2
        assert all(disabled)
    plays = visit.page.locator('.live-bag button')
    plays.first.wait_for()
    assert all(button.is_disabled() for button in plays.all())
    acts = (
        "'nudge', {speed: 5}",
        "'move', {rotor: 3}",
        "'pause', {paused: true}",
        "'seek', {at: 0}",
    )
    for number, act in enumerate(acts, 1):
        visit.js(f'live.act({act})')
        visit.wait(f'live.answers.log.length === {number}')
    assert all('read-only' in answer for answer in visit.js('live.answers.log'))
    for topic in ('/nudge', '/edge_command', '/tilt'):
        assert not stage.user.count_publishers(topic)
    visit.close()
    stage.close()
    assert visit.console == []
