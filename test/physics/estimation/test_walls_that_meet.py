# SPDX-License-Identifier: Apache-2.0
"""Laws of walls that meet on springs: charges, energies, and how well each is placed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from meeting_walls import NARROW, meeting

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import EventKind, TrackingStatus
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.collisions.runs import INITIAL_DISTANCE, Collision, simulate_frames
from soliton_linkage_studies.collisions.travelling_wall import travelling_wall


class Run(NamedTuple):
    """Frames of a collision."""

    task: Collision
    times: Array
    angles: Array
    rates: Array


@pytest.fixture(scope='module')
def bounce() -> Run:
    task, parts = meeting(NARROW, 0.4), []
    for part in simulate_frames(task):
        parts.append(part)
        if part[0][-1] > 28 * task.unit:
            return Run(task, *map(np.concatenate, zip(*parts, strict=True)))
    raise AssertionError


def analysed(run: Run, noise: float = 0.0, seed: int = 1) -> list[Analysis]:
    analyser, rng = Analyser(run.task.ring), np.random.default_rng(seed)
    found = [
        analyser.analyse(round(time * 1e9), angles + rng.normal(0, noise, len(angles)), rates)
        for time, angles, rates in zip(run.times, run.angles, run.rates, strict=True)
    ]
    return [each for each in found if each is not None]


def starts(run: Run) -> tuple[float, float]:
    """Where both walls begin, on the grid that they were made on."""
    ring, task = run.task.ring, run.task
    points = travelling_wall(ring, task.speed * task.sound * ring.spacing, 1).points
    middle, half = (ring.number_of_rotors - 1) / 2, INITIAL_DISTANCE * task.reach / 2
    return -np.rint((half - middle) * points) / points, -np.rint(
        (-half - middle) * points
    ) / points


def test_charges_add_up_and_what_a_collision_radiates_is_what_phonons_have(bounce: Run) -> None:
    found = analysed(bounce)
    assert all(sum(each.charge for each in one.solitons) == 0 for one in found)
    assert {each.id for one in found for each in one.solitons} == {1, 2}
    events = [(k, each) for k, one in enumerate(found) for each in one.events]
    assert [each.kind for _, each in events] == [
        EventKind.FOUND,
        EventKind.FOUND,
        EventKind.BOUNCE,
    ]
    told, met = events[-1]
    assert (met.ids_before, met.ids_after, met.charge_before, met.charge_after) == (
        (1, 2),
        (1, 2),
        0,
        0,
    )
    energies = found[told].energies
    assert energies is not None
    assert met.energy_before == pytest.approx(energies.whole, rel=1e-4)
    radiated = met.energy_before - met.energy_after
    assert radiated == pytest.approx(energies.wake, abs=2e-5 * energies.whole)
    assert 0 < radiated < 0.1 * energies.whole


def test_each_wall_is_placed_as_well_as_is_said(bounce: Run) -> None:
    run, errors = bounce, []
    speed = run.task.speed * run.task.sound
    left, right = starts(run)
    first = run.times < 3.2 / run.task.speed * run.task.unit
    part = Run(run.task, run.times[first], run.angles[first], run.rates[first])
    for seed in (1, 2):
        for time, one in zip(part.times, analysed(part, 0.01, seed), strict=True):
            assert one.status is not TrackingStatus.LOST
            for wall in one.solitons:
                true = left + speed * time if wall.charge > 0 else right - speed * time
                errors.append((wall.position - true) / wall.position_deviation)
    assert len(errors) == 4 * np.count_nonzero(first)
    assert 0.4 < math.sqrt(np.mean(np.square(errors))) < 1.2
    assert max(map(abs, errors)) < 4.5


def test_a_wall_of_a_free_chain_and_two_more_have_charges_of_the_outer_domains() -> None:
    chain = Chain(60, rest_angle=0.5)
    rotors = np.arange(60)
    width = chain.wall_width / chain.spacing
    analyser = Analyser(chain)
    for k in range(20):
        order = -np.prod([np.tanh((rotors - x) / width) for x in (12 + 0.1 * k, 30, 46)], axis=0)
        theta = np.arcsin(order * math.sin(chain.rest_angle))
        found = analyser.analyse(k * 4_000_000, np.where(rotors % 2, np.pi - theta, theta))
        assert found is not None
        assert found.topology is not None
        assert sum(each.charge for each in found.solitons) == found.topology.charge == 1
    assert [(each.id, each.charge) for each in found.solitons] == [(1, 1), (2, -1), (3, 1)]
    places = [each.rotor for each in found.solitons]
    np.testing.assert_allclose(places, (13.9, 30, 46), atol=0.05)
