# SPDX-License-Identifier: Apache-2.0
"""Fixtures: each test has its own domain and programs that end with it."""

import itertools
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import domain_coordinator
import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.programs.simulated_controller import PseudoTerminal
from soliton_linkage_nodes.runtime.child_processes import restrict_to_loopback

sys.path.append(str(Path(__file__).parent))

from graphs import Graph
from programs import Program

WORKER = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
WORKERS = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
# Each worker rotates through its own domains, so that no test receives messages of an earlier one.
# The tests in a browser use the domains from 81.
_next_domain = partial(next, itertools.cycle(range(1 + WORKER, 81, WORKERS)))

restrict_to_loopback()


def pytest_itemcollected(item: pytest.Item) -> None:
    for warning in ('RuntimeWarning', 'pytest.PytestUnhandledThreadExceptionWarning'):
        item.add_marker(pytest.mark.filterwarnings(f'error::{warning}'))


@pytest.fixture
def graph():
    with domain_coordinator.domain_id(_next_domain) as domain:
        graph = Graph(domain)
        yield graph
        graph.close()


@pytest.fixture
def start(graph, tmp_path):
    """Start a program of the suite on the test's domain, or a command that runs it."""
    programs: list[Program] = []

    def start_program(name: str, *arguments: str, command: Sequence[str] = ()) -> Program:
        log = tmp_path / f'{name}_{len(programs)}.log'
        programs.append(Program(name, list(arguments), graph.domain, log, command))
        return programs[-1]

    yield start_program
    for program in programs:
        program.process.kill()
        program.process.wait()


@pytest.fixture
def named():
    return NamedChain(Chain(number_of_rotors=8), default_joint_names(8))


@pytest.fixture
def terminal():
    """A serial port with its other end in the test."""
    opened = PseudoTerminal()
    yield opened
    opened.close()


@pytest.fixture
def said(capfd):
    """Return the log lines of the nodes so far."""
    lines: list[str] = []

    def read() -> str:
        lines.append(capfd.readouterr().err)
        return ''.join(lines)

    return read
