# SPDX-License-Identifier: Apache-2.0
"""Errors of one encoder are recognised by their shape, and correct encoders have none."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, SPINNER, WOBBLER, passage, read, unequal

from soliton_linkage.identification.adjustment import adjust
from soliton_linkage.identification.encoder_errors import (
    EncoderFault,
    bar_scores,
    encoder_fault,
    shown_by_bars,
)
from soliton_linkage.identification.lengths import initial_lengths
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linkage.chain import Array, Chain

CLASSES = {'flipper': FLIPPER, 'wobbler': WOBBLER, 'spinner': SPINNER}
NAMES = [f'rotor_{n}' for n in range(12)]


def with_play(angles: Array) -> Array:
    shown = [angles[0]]
    for angle in angles[1:]:
        shown.append(np.clip(shown[-1], angle - 0.1, angle + 0.1))
    return np.array(shown)


def found_fault(nominal: Chain, change: Callable[[Array], Array]) -> EncoderFault | None:
    """Error that is found after `change` of the readings of rotor 5 in a passage and back."""
    angles = passage(unequal(replace(nominal, number_of_rotors=12), 2), 300)
    angles = np.concatenate([angles, angles[::-1]])
    readings = read(angles, 2)[0]
    readings[:, 5] += change(angles[:, 5]) - angles[:, 5]
    found = adjust(readings, initial_lengths(readings))
    recording = Readings(np.arange(len(readings)) / 250, readings, names=NAMES)
    return encoder_fault(NAMES, *bar_scores(recording, found, found.noise))


@pytest.mark.parametrize('nominal', CLASSES.values(), ids=CLASSES)
def test_the_error_of_an_encoder_is_recognised_by_its_shape(nominal):
    assert found_fault(nominal, lambda angles: angles) is None
    for change, words in (
        (
            lambda angles: 1.06 * angles,
            'rotor_5 has (a wrong gain|an encoder whose error depends)',
        ),
        (with_play, 'rotor_5 has an encoder with a play of .* rad, or one that slips'),
        (
            lambda angles: angles + 0.15 * np.sin(3 * angles),
            'rotor_5 has an encoder whose error depends on the angle',
        ),
    ):
        fault = found_fault(nominal, change)
        assert fault is not None
        assert re.match(words, fault.text)


@pytest.mark.parametrize('shape', [0, 1, 3], ids=['gain', 'play', 'nonlinearity'])
def test_an_error_that_bars_do_not_show_is_reported_as_a_force(shape):
    fault = EncoderFault('rotor_0 has an encoder with play', 100.0, 0)
    scores, information = np.zeros(6 * 12), 1e4 * np.eye(6 * 12)
    text = shown_by_bars(fault, NAMES, scores, information).text
    assert text.startswith('a force that was not recorded acts: a hand, or a rotor')
    assert text.endswith(fault.text)
    scores[12 * shape] = 500.0
    assert shown_by_bars(fault, NAMES, scores, information) == fault
    scores[12 * shape : 12 * shape + 2] = 0.0, 500.0
    assert shown_by_bars(fault, NAMES, scores, information) != fault


def test_a_force_is_named_before_an_error_of_an_edge_rotor_that_depends_on_the_angle():
    information = 1e4 * np.eye(6 * 12)
    for rotor in (0, 5, 11):
        scores = np.zeros(6 * 12)
        scores[2 * 12 + rotor] = 3000.0
        fault = encoder_fault(NAMES, scores, information)
        assert fault is not None
        assert fault.text.startswith('a force that was not recorded') == (rotor != 5)
        assert f'rotor_{rotor} has an encoder whose error depends on the angle' in fault.text


@pytest.mark.parametrize(('deviations', 'certain'), [(2.8, None), (3.5, False), (4.8, True)])
def test_a_gain_error_is_reported_as_certain_only_if_noise_cannot_cause_it(deviations, certain):
    scores = np.zeros(6 * 12)
    scores[0] = 30.0 * deviations
    fault = encoder_fault(NAMES, scores, 900.0 * np.eye(6 * 12))
    assert (fault and fault.certain) == certain
