# SPDX-License-Identifier: Apache-2.0
"""Tests of the studies share the chains of the physics tests; a warning is an error."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / 'physics'))


def pytest_itemcollected(item: pytest.Item) -> None:
    item.add_marker(pytest.mark.filterwarnings('error'))
