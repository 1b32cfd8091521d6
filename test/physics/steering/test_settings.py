# SPDX-License-Identifier: Apache-2.0
"""The settings of the steering have their effect and are rejected out of range."""

from dataclasses import fields, replace

import numpy as np
import pytest
from chains import FLIPPER
from driven_walls import PERIOD, ROTORS, move_to, rigid_loop
from orbits import uniform_orbit

from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.steering.reference_trajectory import adiabatic_rate, bandwidth
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings


def time_of_move(settings: SteeringSettings) -> float:
    """Return the time at which a move by one spacing has ended [s]."""
    loop, _ = rigid_loop(FLIPPER, 4.0, settings)
    move_to(loop, 5.0)
    return loop.time


def test_each_setting_has_a_description_and_its_default_is_in_range():
    described = described_fields(SteeringSettings)
    assert set(described) == {field.name for field in fields(SteeringSettings)}
    for name, quantity in described.items():
        assert quantity.complaint(getattr(DEFAULTS, name)) is None
        with pytest.raises(ValueError, match=name):
            SteeringSettings(**{name: -1})


def test_rates_and_bandwidths_scale_with_their_fractions():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    slower = replace(DEFAULTS, adiabatic_fraction=0.25, bandwidth_share=1 / 16)
    assert adiabatic_rate(orbit, slower) == adiabatic_rate(orbit) / 2
    assert bandwidth(orbit, PERIOD, slower) == bandwidth(orbit, PERIOD) / 2
    later = replace(DEFAULTS, bandwidth_step=0.01)
    assert bandwidth(orbit, PERIOD, later) == pytest.approx(0.01 / PERIOD)


def test_the_settings_of_durations_change_the_time_of_a_move():
    b = bandwidth(uniform_orbit(FLIPPER, ROTORS), PERIOD)
    usual = time_of_move(DEFAULTS)
    longer = time_of_move(replace(DEFAULTS, min_duration=20.0))
    assert longer - usual == pytest.approx(10 / b, abs=3 * PERIOD)
    restful = time_of_move(replace(DEFAULTS, settling_time=6.0))
    assert restful - usual == pytest.approx(3 / b, abs=3 * PERIOD)


def test_a_wall_is_lost_beyond_max_error():
    # An impulse that displaces the wall by half a spacing.
    for largest, held in ((1.0, True), (0.25, False)):
        settings = replace(DEFAULTS, max_error=largest, max_restarts=0)
        loop, wall = rigid_loop(FLIPPER, 4.0, settings)
        move_to(loop, 5.0)
        wall.rate = 6.0
        loop.go_on(2.0)
        assert loop.steering.holding is held


def test_frames_may_be_missing_for_the_detection_timeout():
    for timeout, held in ((0.1, False), (0.4, True)):
        loop, _ = rigid_loop(FLIPPER, 4.0, replace(DEFAULTS, detection_timeout=timeout))
        move_to(loop, 5.0)
        for _ in range(25):
            loop.steering.observe(loop.time, np.full(ROTORS, np.nan))
            loop.steering.torques()
            loop.frames += 1
        assert loop.steering.holding is held
