# SPDX-License-Identifier: Apache-2.0
"""Configuration of the study tests: chains of the physics tests, and warnings as errors."""

import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from soliton_linkage_studies import program, workers
from soliton_linkage_studies.sweep import table

sys.path.append(str(Path(__file__).parents[1] / 'physics'))
sys.path.append(str(Path(__file__).parent))

from pools import Here


def pytest_itemcollected(item: pytest.Item) -> None:
    item.add_marker(pytest.mark.filterwarnings('error'))


@pytest.fixture(autouse=True, scope='module')
def one_worker_is_this_process():
    """Run a study with one worker in this process, because the start of a process takes seconds.

    The tests of workers, and of studies with two workers, start processes.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module in (program, table):
            patch.setattr(
                module,
                'local_processes',
                lambda count: (
                    nullcontext(Here()) if count == 1 else workers.local_processes(count)
                ),
            )
        yield
