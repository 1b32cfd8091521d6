# SPDX-License-Identifier: Apache-2.0
"""The terminal line shows rotor directions, several rotors per mark for a long chain."""

import numpy as np

from soliton_linkage_nodes.programs.watch_soliton import drawn


def test_each_rotor_has_its_mark():
    assert drawn(np.array([1.0, 0.4, 0.2, -0.3, -1.0, np.nan]), [], 80) == r'//||\?'


def test_a_uniform_chain_leans_one_way():
    assert drawn(np.ones(5), [], 5) == '/////'
    assert drawn(-np.ones(5), [], 5) == '\\\\\\\\\\'


def test_solitons_are_where_they_are_and_stay_on_the_line():
    assert drawn(np.ones(5), [2.6], 5) == '///O/'
    assert drawn(np.ones(5), [-3.0, 9.0], 5) == 'O///O'


def test_on_a_short_line_a_mark_is_the_mean_of_several():
    leans = np.concatenate([np.ones(500), -np.ones(500)])
    leans[:5] = np.nan
    picture = drawn(leans, [499.0], 10)
    assert picture == '////O\\\\\\\\\\'
    assert drawn(np.full(20, np.nan), [], 10) == 10 * '?'
