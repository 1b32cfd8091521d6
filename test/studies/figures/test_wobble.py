# SPDX-License-Identifier: Apache-2.0
"""The wavelength of the oscillation next to a wobbling wall is measured correctly."""

import numpy as np
import pytest

from soliton_linkage_studies.figures.wobble import wavelength


def test_the_wavelength_of_a_decaying_wave_is_measured():
    for length in [2.0, 2.22, 3.1, 7.0]:
        rotors = np.arange(120)
        wave = np.exp(-rotors / 40) * np.cos(2 * np.pi * rotors / length + 0.4)
        assert wavelength(wave) == pytest.approx(length, rel=0.02)


def test_a_signal_without_sign_changes_has_infinite_wavelength():
    assert wavelength(np.exp(-np.arange(9.0))) == np.inf
