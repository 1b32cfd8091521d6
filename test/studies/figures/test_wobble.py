# SPDX-License-Identifier: Apache-2.0
"""The oscillation beside a wobbling wall is measured, whatever it is."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage_studies.figures.wobble import wavelength


@pytest.mark.parametrize('length', [2.0, 2.22, 3.1, 7.0])
def test_the_length_of_any_wave_that_decays_is_found(length: float) -> None:
    rotors = np.arange(120)
    wave = np.exp(-rotors / 40) * np.cos(2 * np.pi * rotors / length + 0.4)
    assert wavelength(wave) == pytest.approx(length, rel=0.02)


def test_what_does_not_change_its_sign_is_no_wave() -> None:
    assert wavelength(np.exp(-np.arange(9.0))) == np.inf
