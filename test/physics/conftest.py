# SPDX-License-Identifier: Apache-2.0
"""The tests of physics share chains and a linkage motion, and take a warning for an error."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))


def pytest_itemcollected(item: pytest.Item) -> None:
    item.add_marker(pytest.mark.filterwarnings('error'))
