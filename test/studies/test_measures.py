# SPDX-License-Identifier: Apache-2.0
"""Measures agree with the theory of slow walls, with energies and with the bonds of a chain."""

import dataclasses
import math

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, chain_of

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage.solitons.track import Crossing, Track
from soliton_linkage_studies.measures import (
    MEASURES,
    SweepTrial,
    measure_motion,
    measure_speed,
    measure_survival,
    phonon_share,
    send_wall,
)

QUICK = {'tolerance': 1e-5, 'time_limit': 1000.0}


def test_without_deviations_the_motion_is_the_class_of_the_chain():
    for example in EXAMPLES:
        chain = chain_of(example, 20)
        assert measure_motion(chain, SweepTrial()) == {
            'motion': chain.motion.value,
            'obstacles': 0,
        }


def test_one_bond_of_another_class_blocks_the_wall():
    chain = chain_of(SPINNER, 9)
    fractions = (*[0.0] * 4, 0.8, *[0.0] * 3)
    mixed = dataclasses.replace(chain, deviations=Deviations(rest_length=fractions))
    assert measure_motion(mixed, SweepTrial()) == {'motion': 'blocked', 'obstacles': 1}


@pytest.mark.parametrize(('example', 'kick'), [(FLIPPER, 0.04), (SPINNER, 0.15)])
def test_slow_walls_have_the_speed_of_rigid_bars(example, kick):
    chain = chain_of(example, 14)
    # v = v0 / Lambda, where Lambda / r is the arc of the motion of bars over one spacing.
    taken = measure_speed(chain, SweepTrial(kick=kick, **QUICK))
    assert taken['outcome'] == 'returns'
    slow = kick / (site_arc(chain) * chain.rotor_length / chain.spacing)
    # Springs stretch by (v / c)^2, here 0.02; each end of a crossing has an error of one frame.
    assert taken['speed'] == pytest.approx(slow, rel=0.05)


def test_a_faster_kick_leaves_more_phonons():
    chain = chain_of(FLIPPER, 20)
    slow, fast = (
        float(measure_speed(chain, SweepTrial(kick=kick, **QUICK))['phonons'])
        for kick in (0.1, 0.3)
    )
    assert 0 <= slow < 0.01
    assert fast > 10 * slow


def test_the_energies_of_wall_and_phonons_sum_to_the_total():
    chain = chain_of(FLIPPER, 20)
    recording, track, crossings = send_wall(chain, SweepTrial(kick=0.2, **QUICK))
    share = phonon_share(chain, recording, track, crossings[0])
    # Waves that are added far from the wall count in full at any speed.
    middle = float(np.nanmean([crossings[0].start, crossings[0].end]))
    inside = np.abs(track.sites - 9.5)
    frame = int(np.nanargmin(np.where(track.times <= crossings[0].end, inside, np.nan)))
    assert track.times[frame] == pytest.approx(middle, rel=0.2)
    energy = float(
        chain.kinetic_energy(recording.rates[frame])
        + chain.elastic_energy(recording.angles[frame])
    )
    rates = recording.rates.copy()
    gained = energy - 0.5 * chain.moment_of_inertia * rates[frame, 0] ** 2
    rates[frame, 0] = math.sqrt(2 * energy / chain.moment_of_inertia)
    louder = dataclasses.replace(recording, rates=rates)
    outside = share * energy - 0.5 * chain.moment_of_inertia * recording.rates[frame, 0] ** 2
    expected = (outside + energy) / (gained + energy)
    assert phonon_share(chain, louder, track, crossings[0]) == pytest.approx(expected, rel=1e-9)


def test_the_recording_of_a_sent_wall_is_one_motion():
    lengths = drawn_deviations(12, 3, rotor_length=0.02, stiffness=0.02)
    for chain, trial in [
        (dataclasses.replace(chain_of(FLIPPER, 12), deviations=lengths), SweepTrial(kick=0.1)),
        (chain_of(SPINNER, 14), SweepTrial(kick=0.3, **QUICK)),
        (dataclasses.replace(chain_of(FLIPPER, 9), damping=1e-6), SweepTrial(0.1, **QUICK)),
        (chain_of(FLIPPER, 14), SweepTrial(kick=0.01, time_limit=30.0, tolerance=1e-5)),
    ]:
        sent = send_wall(chain, trial)
        whole = ElasticSimulation(
            chain,
            sent.recording.angles[0],
            sent.recording.rates[0],
            chain.time_unit,
            trial.tolerance,
        ).record(sent.recording.times[-1])
        np.testing.assert_allclose(sent.recording.times, whole.times, atol=1e-12)
        np.testing.assert_array_equal(sent.recording.angles, whole.angles)
        np.testing.assert_array_equal(sent.recording.rates, whole.rates)
        assert len(sent.crossings) == (0 if trial.kick == 0.01 else 2)


def test_a_chain_without_rest_state_is_an_error():
    stretched = Deviations(rest_length=(0.0,) * 4 + (-0.9,) + (0.0,) * 4)
    wrong = dataclasses.replace(chain_of(FLIPPER, 10), deviations=stretched)
    with pytest.raises((ArithmeticError, ValueError)):
        send_wall(wrong, SweepTrial(kick=0.2, **QUICK))


def test_without_enough_rotors_outside_the_wall_phonons_are_nan():
    chain = chain_of(FLIPPER, 8)
    recording, track, _ = send_wall(chain, SweepTrial(kick=0.1, **QUICK))
    whole = Crossing(0.0, float(track.times[-1]), -1, 1.0)
    assert math.isnan(phonon_share(chain, recording, track, whole))


def test_a_wall_is_lost_at_the_time_limit():
    taken = measure_speed(chain_of(FLIPPER, 30), SweepTrial(kick=0.02, time_limit=20.0))
    assert taken['outcome'] == 'lost'
    assert math.isnan(float(taken['speed']))
    assert math.isnan(float(taken['phonons']))


@pytest.mark.parametrize(('spacings_a_frame', 'crossings'), [(1.0, 1), (3.0, 1), (20.0, 0)])
def test_a_track_that_jumps_to_another_wall_is_no_crossing(
    spacings_a_frame, crossings, monkeypatch
):
    chain = chain_of(FLIPPER, 30)

    def path(_chain: Chain, recording: Recording) -> Track:
        frames = recording.times / chain.time_unit
        positions = np.clip(29 - spacings_a_frame * (frames - 10), 0, 29)
        return Track(recording.times, positions, 0 * positions)

    monkeypatch.setattr('soliton_linkage_studies.measures.follow', path)
    assert len(send_wall(chain, SweepTrial(kick=0.01, time_limit=60.0))[2]) == crossings


@pytest.mark.parametrize('mechanics', ['elastic', 'rigid'])
@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_walls_of_uniform_chains_return(example, mechanics):
    kick = 0.3 if example is SPINNER else 0.1
    trial = SweepTrial(kick=kick, mechanics=mechanics, **QUICK)
    taken = measure_survival(chain_of(example, 10), trial)
    assert taken == {'outcome': 'returns', 'obstacles': 0}


def test_bars_that_stop_a_wall_have_obstacles():
    outcomes = set()
    for seed in range(8):
        deviations = drawn_deviations(8, seed, rotor_length=0.08, spacing=0.08)
        chain = dataclasses.replace(chain_of(FLIPPER, 8), deviations=deviations)
        try:
            taken = measure_survival(chain, SweepTrial(mechanics='rigid'))
        except ValueError:
            assert blocked_bonds(chain).any()
            continue
        outcomes.add(taken['outcome'])
        assert taken['outcome'] == 'returns' or int(taken['obstacles']) > 0
    assert len(outcomes) > 1


def test_a_measure_returns_its_columns_and_its_classes():
    for name in MEASURES:
        measure = MEASURES[name]
        taken = measure.take(Chain(6), SweepTrial(kick=0.2, tolerance=1e-4, time_limit=100.0))
        assert tuple(taken) == measure.columns
        assert measure.shown in measure.columns
        assert not measure.classes or taken[measure.shown] in measure.classes


def test_a_trial_out_of_range_is_rejected():
    for values, complaint in [
        ({'kick': 0.0}, r'SweepTrial.kick = 0.0 must lie in the range 1e-09 to 1000'),
        ({'mechanics': 'soft'}, "SweepTrial.mechanics = 'soft' must be one of 'elastic', 'rigid'"),
        ({'time_limit': 0.0}, r'SweepTrial.time_limit = 0.0 must lie in the range 1 to'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            SweepTrial(**values)
