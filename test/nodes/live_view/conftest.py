# SPDX-License-Identifier: Apache-2.0
"""One graph and one browser for all tests of the page."""

from __future__ import annotations

import itertools
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import domain_coordinator
import pytest

sys.path.append(str(Path(__file__).parent))

from live_stage import Stage

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
_domains = itertools.count(101 + int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:]), 20)


@pytest.fixture(scope='module')
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    with domain_coordinator.domain_id(lambda: next(_domains)) as domain:
        before = os.environ.get('ROS_DOMAIN_ID')
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        made = Stage(domain, tmp_path_factory.mktemp('live'))
        yield made
        made.close()
        if before is None:
            del os.environ['ROS_DOMAIN_ID']
        else:
            os.environ['ROS_DOMAIN_ID'] = before


@pytest.fixture(scope='module')
def browser() -> Iterator[Any]:
    sync = pytest.importorskip('playwright.sync_api', reason='Playwright is not installed')
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f'no browser for the page: none of {", ".join(BROWSERS)} is installed')
    with sync.sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=path, args=['--no-sandbox', '--disable-gpu']
        )
        yield started
        started.close()
