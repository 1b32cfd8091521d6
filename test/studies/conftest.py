# SPDX-License-Identifier: Apache-2.0
"""Configuration of the study tests: chains of the physics tests, and warnings as errors."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / 'physics'))


def pytest_itemcollected(item: pytest.Item) -> None:
    item.add_marker(pytest.mark.filterwarnings('error'))
