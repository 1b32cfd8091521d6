# SPDX-License-Identifier: Apache-2.0
"""The directives of the pages and the examples are imported from where they stand."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / 'docs/extensions'), str(ROOT / 'examples')]


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'agg')
