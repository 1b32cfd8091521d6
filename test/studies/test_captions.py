# SPDX-License-Identifier: Apache-2.0
"""Captions describe a chain."""

from chains import SPINNER, chain_of

from soliton_linkage_studies.drawing import class_and_shape, description, parameters, shape

CHAIN = chain_of(SPINNER, 20)


def test_a_caption_names_class_and_parameters():
    assert class_and_shape(CHAIN) == 'spinner (2, 1.18)'
    assert parameters(CHAIN) == 'r/a = 2, θ̄ = 1.18'
    assert shape(CHAIN) == 'r/a = 2, θ̄ = 1.18, d = 3.70'
    said = 'spinner: r/a = 2, rest angle 1.18 rad, d = 3.70, 20 rotors'
    assert description(CHAIN) == said
