# SPDX-License-Identifier: Apache-2.0
"""Readers reject corrupted input with a one-line error; `make fuzz` runs longer."""

import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

sys.path.append(str(Path(__file__).parent))

from readers import TARGETS, corpus, wounded

EXAMPLES = 25
FOUND = [(name, path) for name in TARGETS for path in corpus(name)]


@pytest.mark.parametrize('name', TARGETS)
def test_corrupted_input_is_rejected_on_one_line(name):
    @settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
    @given(wounded(TARGETS[name].examples()))
    def feed(content: bytes) -> None:
        TARGETS[name].feed(content)

    feed()


@pytest.mark.parametrize(('name', 'path'), FOUND, ids=[path.name for _, path in FOUND])
def test_the_inputs_of_the_corpus_are_rejected(name, path):
    TARGETS[name].feed(path.read_bytes())


def test_the_corpus_is_small():
    assert sum(path.stat().st_size for _, path in FOUND) < 200_000
