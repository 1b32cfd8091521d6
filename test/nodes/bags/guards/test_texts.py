# SPDX-License-Identifier: Apache-2.0
"""Malicious texts are rejected early; valid texts are read."""

import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_nodes.bags.guards import MAX_TEXT_SIZE, load_json, load_yaml, parse_count

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text('abc: {}[]&*!-1.\n', max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text('ab'), inner, max_size=3),
    max_leaves=8,
)


@given(PLAIN)
def test_plain_yaml_is_read_unchanged(value):
    assert load_yaml(yaml.safe_dump(value)) == value


def test_yaml_is_rejected_with_its_reason():
    for text, why in [
        ('a: &a [1]\nb: *a', 'alias'),
        ('[' * 40 + ']' * 40, 'deeper than 30 levels'),
        ('x: ' + '1:' * 1000 + '1', 'a number of 2001 characters'),
        ('x' * (MAX_TEXT_SIZE + 1), 'more than 4194304'),
        ('!!python/object/apply:os.system ["true"]', 'python/object'),
        ('[{', 'flow'),
        ('x: \x00', 'characters are not allowed'),
    ]:
        with pytest.raises(ValueError, match=why):
            load_yaml(text)


def test_json_is_rejected():
    for text in ['[' * 100_000, 'Infinity', '{"a": NaN}', '[', '1' * 5_000_000]:
        with pytest.raises(ValueError, match=r'.'):
            load_json(text)


def test_json_is_read():
    for text in ['"[[["', '"\\"[["', '{"a": [1, 2]}']:
        assert load_json(text) is not None


def test_an_invalid_count_is_none():
    for value in [-1, math.inf, math.nan, 2**63, True, None, 'many', '-3', '9' * 50, [1], 1.5]:
        assert parse_count(value) == 0


def test_counts_are_read():
    for value, count in [(3, 3), ('42', 42), (0, 0), (2**63 - 1, 2**63 - 1)]:
        assert parse_count(value) == count
