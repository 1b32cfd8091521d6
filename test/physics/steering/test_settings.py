# SPDX-License-Identifier: Apache-2.0
"""The numbers of the steering do what they say, and are refused out of their range."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from chains import FLIPPER
from driven_walls import Loop, RigidWall, orbit_of_example

from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.steering.reference_trajectory import adiabatic_rate, bandwidth
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings
from soliton_linkage.steering.steering import Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation

ROTORS = 10
PERIOD = 0.01


def moved(settings: SteeringSettings) -> Loop:
    """A loop in which a wall of rigid bars has been carried by a spacing."""
    orbit = orbit_of_example(FLIPPER, ROTORS)
    steering = Steering(orbit, TorqueAllocation(orbit, torque_limit=0.1), settings)
    loop = Loop(steering, RigidWall(orbit, orbit.arc_at(4.0, 0)), PERIOD)
    loop.go_on(0.2)
    assert steering.move(5.0) is None
    assert loop.until_ended().outcome is Outcome.REACHED
    return loop


def test_each_is_described_with_its_range_in_which_its_default_is() -> None:
    described = described_fields(SteeringSettings)
    assert set(described) == {field.name for field in fields(SteeringSettings)}
    for name, quantity in described.items():
        assert quantity.complaint(getattr(DEFAULTS, name)) is None
        with pytest.raises(ValueError, match=name):
            SteeringSettings(**{name: -1})


def test_rates_and_bandwidths_go_with_their_shares() -> None:
    orbit = orbit_of_example(FLIPPER, ROTORS)
    slower = replace(DEFAULTS, adiabatic_fraction=0.25, bandwidth_share=1 / 16)
    assert adiabatic_rate(orbit, slower) == adiabatic_rate(orbit) / 2
    assert bandwidth(orbit, PERIOD, slower) == bandwidth(orbit, PERIOD) / 2
    later = replace(DEFAULTS, bandwidth_step=0.01)
    assert bandwidth(orbit, PERIOD, later) == pytest.approx(0.01 / PERIOD)


def test_moves_take_as_long_as_they_are_told_to() -> None:
    b = bandwidth(orbit_of_example(FLIPPER, ROTORS), PERIOD)
    usual = moved(DEFAULTS).time
    longer = moved(replace(DEFAULTS, shortest_move=20.0)).time
    assert longer - usual == pytest.approx(10 / b, abs=3 * PERIOD)
    restful = moved(replace(DEFAULTS, rest=6.0)).time
    assert restful - usual == pytest.approx(3 / b, abs=3 * PERIOD)


def test_a_wall_is_lost_where_it_is_told_to_be() -> None:
    # A blow by which it gets off by half a spacing.
    for largest, held in ((1.0, True), (0.25, False)):
        loop = moved(replace(DEFAULTS, largest_error=largest, most_restarts=0))
        assert isinstance(loop.wall, RigidWall)
        loop.wall.rate = 6.0
        loop.go_on(2.0)
        assert loop.steering.holding is held


def test_frames_may_be_missing_for_as_long_as_they_are_told_to() -> None:
    for timeout, held in ((0.1, False), (0.4, True)):
        loop = moved(replace(DEFAULTS, seen_timeout=timeout))
        for _ in range(25):
            loop.steering.observe(loop.time, np.full(ROTORS, np.nan))
            loop.steering.torques()
            loop.frames += 1
        assert loop.steering.holding is held
