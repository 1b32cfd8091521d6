# SPDX-License-Identifier: Apache-2.0
"""Chains are identified from readings, and unsuitable recordings are rejected in one line."""

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, NAMES, SPINNER, WOBBLER, passage, read, unequal

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.adjustment import adjust
from soliton_linkage.identification.diagnosis import check_explained, length_warnings
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import initial_lengths, split
from soliton_linkage.identification.mounting import absent_joints
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations

TIMES = np.arange(500) / 250
READINGS = read(passage(unequal(FLIPPER, 3)), 3)[0]


def changed(rotor: int, change: Callable[[Array], Array]) -> Array:
    readings = READINGS.copy()
    readings[:, rotor] = change(readings[:, rotor])
    return readings


def ordered(*rotors: int) -> Array:
    return READINGS[:, list(rotors)]


def half_missing() -> Array:
    readings = READINGS.copy()
    readings[:, ::2] = np.nan
    return readings


def slipping() -> Array:
    readings = READINGS.copy()
    readings[400:, 3] += 0.3
    return readings


def resting() -> Array:
    return READINGS[0] + 0.01 * np.random.default_rng(1).standard_normal(READINGS.shape)


BAD = {
    'backwards': (changed(4, np.negative), 'rotor_4 is mounted backwards'),
    'half a turn off': (
        changed(4, lambda angles: angles + math.pi),
        'rotor_4 has an error of half',
    ),
    'zero far off': (changed(6, lambda angles: angles + 1.3), 'rotor_6 does not change its side'),
    'neighbours swapped': (ordered(0, 1, 2, 4, 3, 5, 6, 7, 8, 9), 'not in the order'),
    'seen from behind': (READINGS[:, ::-1], 'seen from behind'),
    'degrees': (np.rad2deg(READINGS), '^the angles look like degrees; publish radians$'),
    'half missing': (half_missing(), '5 of 10 rotors are missing .* rotor_0, rotor_2'),
    'slipping': (slipping(), 'the encoder of rotor_3 slips by about 0.29 rad at 1.6 s'),
    'nonlinear': (
        changed(5, lambda angles: angles + 0.3 * np.sin(5 * angles))[::8],
        'rotor_5 has an encoder whose error depends on the angle',
    ),
    'nothing passes': (resting(), 'no soliton passes'),
    'half a passage': (np.repeat(READINGS[:250], 2, axis=0), 'passes only .* inner rotors'),
}


@pytest.mark.parametrize(('readings', 'words'), BAD.values(), ids=BAD)
def test_unsuitable_recordings_are_rejected(readings, words):
    times = np.linspace(0, 2, len(readings), endpoint=False)
    with pytest.raises(ValueError, match=words) as error:
        identify(Readings(times, readings, names=NAMES), Chain())
    assert '\n' not in str(error.value)


def test_the_causes_of_an_unexplained_recording_are_sorted_by_their_share_of_the_residuals():
    recording = Readings(TIMES, READINGS, names=NAMES)
    for some, cause in (
        (np.s_[:, 5], 'rotor_5 '),
        (np.s_[300:320], r'a kick or a hand acts near 1\.2'),
        (np.s_[:], 'joints are missing or not in the order'),
    ):
        residuals = np.random.default_rng(1).standard_normal(READINGS.shape)
        residuals[some] *= 10
        with pytest.raises(ValueError, match=f'no model explains .* causes: {cause}'):
            check_explained('bars', 5.0, (0.05, 0.0), residuals, recording, None)
        with pytest.raises(ValueError, match='causes: a force that was not recorded acts'):
            check_explained('springs', 5.0, (0.05, 0.0), residuals, recording, None)


FORMULAS: dict[str, Callable[[Array], Array]] = {
    '-phi': np.negative,
    'pi - phi': lambda angles: math.pi - angles,
    'phi - pi': lambda angles: angles - math.pi,
}


@pytest.mark.parametrize(
    ('rotor', 'fault'),
    [
        (0, np.negative),
        (5, lambda angles: math.pi - angles),
        (9, lambda angles: angles + math.pi),
    ],
)
def test_the_formula_that_an_error_recommends_makes_the_recording_acceptable(rotor, fault):
    readings = changed(rotor, fault)
    fault_named = f'rotor_{rotor} (is mounted backwards|has an error of half)'
    with pytest.raises(ValueError, match=fault_named) as error:
        identify(Readings(TIMES, readings, names=NAMES), Chain())
    named = re.search(r'publish (.*?) for it', str(error.value))
    assert named
    readings[:, rotor] = FORMULAS[named[1]](readings[:, rotor])
    assert identify(Readings(TIMES, readings, names=NAMES), Chain()).rigid


KICKS = {
    'flipper': (FLIPPER, 10.0, 1.4),
    'wobbler': (WOBBLER, 4.0, 3.9),
    'spinner': (SPINNER, 12.5, 1.9),
}
"""Chain, kick [rad/s] and duration [s]."""


def kicked(name: str, seed: int, before: int = 0, hit: int = 0) -> tuple[Chain, Array, Array]:
    """Chain of springs, times and readings; in frame `hit` an unrecorded impulse acts."""
    nominal, speed, duration = KICKS[name]
    chain = unequal(nominal, seed)
    drawn = drawn_deviations(10, seed, mass=0.05, stiffness=0.05)
    chain = replace(chain, deviations=chain.deviations.joined(drawn))
    start = leaning(chain, -1).angles
    simulation = ElasticSimulation(chain, start, period=0.004, tolerance=1e-8)
    angles = []
    for frame in range(before + round(duration / 0.004)):
        if frame == before:
            impulses = speed * edge_mode(chain, start, Edge.FIRST)
            simulation.kick(impulses * chain.moments_of_inertia)
        if hit and frame == hit:
            simulation.kick(np.where(np.arange(10) == 5, 3.0, 0.0) * chain.moments_of_inertia)
        angles.append(simulation.angles.copy())
        simulation.advance()
    return chain, 0.004 * np.arange(len(angles)), read(np.array(angles), seed)[0]


@pytest.mark.parametrize(('name', 'before'), [('flipper', 100), ('wobbler', 0), ('spinner', 0)])
def test_a_rotor_of_a_kicked_chain_that_is_mounted_backwards_is_named(name, before):
    _, times, readings = kicked(name, 3, before)
    for rotor in (0, 4, 9):
        wrong = np.where(np.arange(10) == rotor, -readings, readings)
        with pytest.raises(ValueError, match=f'^rotor_{rotor} is mounted backwards'):
            identify(Readings(times, wrong, names=NAMES), Chain())


def test_absent_joints_are_named_in_an_error_and_in_a_warning():
    rotors = [0, 1, 3, 5, 9]
    names = [NAMES[n] for n in rotors]
    remedy = '; record all rotors, or number the joints without gaps'
    with pytest.raises(
        ValueError, match=f'^the recording has no joint rotor_2, .*7 and 1 more{remedy}$'
    ):
        identify(Readings(TIMES, ordered(*rotors), names=names), Chain())
    numbered = [f'joint{2 * n}' for n in range(10)]
    found = identify(Readings(TIMES, READINGS, names=numbered), Chain())
    assert found.warnings[0].startswith('the recording has no joint joint1, joint3')


def test_a_first_joint_without_the_number_0_is_mentioned():
    assert not absent_joints(NAMES)
    assert absent_joints(NAMES[1:]).startswith('the first joint is rotor_1; if the chain has')
    both = absent_joints(NAMES[1:4] + NAMES[5:])
    assert both.startswith('the recording has no joint rotor_4;')
    assert 'the first joint is rotor_1' in both


@pytest.mark.parametrize(
    ('nominal', 'seed'), [(FLIPPER, 1), (WOBBLER, 3), (SPINNER, 1)], ids=KICKS
)
def test_an_absent_joint_is_not_reported_as_a_zero_error(nominal, seed):
    readings = read(passage(unequal(nominal, seed)), seed)[0]
    letters = [*'abcdefghij']
    for absent in range(2, 8):
        kept = [n for n in range(10) if n != absent]
        names = [letters[n] for n in kept]
        named = f'{letters[absent - 1]} and {letters[absent + 1]} do not move like neighbours'
        with pytest.raises(ValueError, match=named):
            identify(Readings(TIMES, readings[:, kept], names=names), Chain())
    with pytest.raises(ValueError, match='more pairs do not move like neighbours'):
        identify(Readings(TIMES, readings[:, ::2], names=letters[::2]), Chain())


@pytest.mark.parametrize(
    ('name', 'some'), [('flipper', slice(0, 350, 5)), ('spinner', slice(0, 475, 4))]
)
def test_an_absent_last_rotor_is_named_as_a_possible_cause(name, some):
    _, times, readings = kicked(name, 3)
    try:
        found = identify(Readings(times[some], readings[some, :-1], names=NAMES[:-1]), Chain())
    except ValueError as error:
        told = str(error)
    else:
        told = ' '.join(found.warnings)
    assert re.search(r'rotor (that )?is missing before rotor_0 or after rotor_8', told)


def test_an_impossible_spacing_is_reported():
    assert length_warnings(unequal(FLIPPER, 3)) == []
    spacings = (0.0, 0.0, 1.0, *[0.0] * 6)
    wide = replace(FLIPPER, deviations=replace(FLIPPER.deviations, spacing=spacings))
    (warning,) = length_warnings(wide)
    assert 'spacing of bond 2 is 2 times the median' in warning


def test_bars_that_are_assumed_for_want_of_free_motion_are_reported_as_such():
    impulses = [RecordedImpulse(time) for time in np.arange(0.0, 2.0, 0.1).tolist()]
    found = identify(Readings(TIMES, READINGS, impulses=impulses), Chain())
    assert found.rigid
    assert found.warnings[0].startswith('bars are assumed only because no 30 successive frames')


def test_a_slip_beside_an_unrecorded_kick_is_named():
    _, times, readings = kicked('flipper', 3, 0, 175)
    readings[262:, 4] += 0.3
    with pytest.raises(ValueError, match=r'encoder of rotor_4 slips by about 0\.\d+ rad at 1\.0'):
        identify(Readings(times, readings, names=NAMES), Chain())


@pytest.mark.parametrize(
    ('example', 'seed', 'every', 'error'),
    [('flipper', 3, 3, 0.02), ('wobbler', 4, 3, 0.02), ('wobbler', 4, 2, 0.005)],
)
def test_errors_of_stamps_are_reported_and_do_not_spoil_lengths(example, seed, every, error):
    chain, times, readings = kicked(example, seed)
    times, readings = times[::every], readings[::every]
    late = times + np.random.default_rng(1).uniform(0, error, len(times))
    found = identify(Readings(np.sort(late), readings), Chain())
    assert any(line.startswith('stamps have errors of') for line in found.warnings)
    for name in ('rotor_length', 'spacing', 'rest_length'):
        shown, true = (getattr(each, f'{name}s') for each in (found.chain, chain))
        errors = shown / true * chain.spacings.mean() / found.chain.spacings.mean() - 1
        assert np.sqrt(np.mean((errors / found.deviations[name]) ** 2)) < 2, name


def test_the_reported_progress_increases_to_the_end():
    _, times, readings = kicked('spinner', 3)
    for recorded in (Readings(TIMES, READINGS), Readings(times, readings)):
        shown: list[float] = []
        identify(recorded, Chain(), progress=shown.append)
        assert (np.diff(shown) > 0).all()
        assert shown[-1] == 1.0
    assert np.diff(shown).max() < 0.4


@pytest.mark.parametrize('pair', [(3, 5), (8, 9)])
def test_joints_are_accepted_after_the_swap_that_an_error_recommends(pair):
    order = list(range(10))
    order[pair[0]], order[pair[1]] = order[pair[1]], order[pair[0]]
    swapped, names = ordered(*order), [NAMES[n] for n in order]
    with pytest.raises(ValueError, match=r'rotor_\d is before rotor_\d.* swap them') as error:
        identify(Readings(TIMES, swapped, names=names), Chain())
    named = re.findall(r'rotor_\d', str(error.value))
    first, second = (names.index(name) for name in named)
    swapped[:, [first, second]] = swapped[:, [second, first]]
    identify(Readings(TIMES, swapped, names=names), Chain())


def test_the_zero_that_an_error_names_makes_the_recording_acceptable():
    readings = changed(6, lambda angles: angles + 0.8)
    with pytest.raises(ValueError, match='the zero of rotor_6 has an error of about') as error:
        identify(Readings(TIMES, readings, names=NAMES), Chain())
    named = re.search(r'about (\S+) rad', str(error.value))
    assert named
    readings[:, 6] -= float(named[1])
    assert identify(Readings(TIMES, readings, names=NAMES), Chain()).rigid


FEW = {'flipper': slice(0, 350, 2), 'wobbler': slice(0, 750, 4), 'spinner': slice(0, 375, 4)}
"""Frames of a kicked chain that are enough to name the error of an encoder."""


@pytest.mark.parametrize('name', ['flipper', 'spinner'])
def test_a_wrong_gain_is_named_and_its_correction_is_accepted(name):
    _, times, readings = kicked(name, 3)
    times, readings = times[FEW[name]], readings[FEW[name]]
    readings[:, 4] *= 1.06
    with pytest.raises(ValueError, match=r'rotor_4 has a wrong gain, .* too large') as error:
        identify(Readings(times, readings, names=NAMES), Chain())
    named = re.search(r'divide the readings by ([\d.]+)', str(error.value))
    assert named
    factor = float(named[1])
    assert factor == pytest.approx(1.06, abs=0.02)
    readings[:, 4] /= factor
    identify(Readings(times, readings, names=NAMES), Chain())


def test_a_gain_of_an_edge_rotor_that_is_probably_wrong_is_a_warning():
    _, times, readings = kicked('wobbler', 5)
    times, readings = times[FEW['wobbler']], readings[FEW['wobbler']]
    readings[:, 0] *= 1.1
    found = identify(Readings(times, readings, names=NAMES), Chain())
    assert re.search(
        r'larger than stated: rotor_0 has a wrong gain, .* too large', found.warnings[0]
    )


def test_a_wrong_gain_is_not_reported_as_a_kick():
    _, times, readings = kicked('flipper', 4)
    readings[:, 5] *= 1.1
    with pytest.raises(ValueError, match=r'^rotor_5 has a wrong gain, .* too large'):
        identify(Readings(times, readings, names=NAMES), Chain())


@pytest.mark.parametrize('name', KICKS)
def test_play_of_an_encoder_is_named(name):
    _, times, readings = kicked(name, 3)
    rotor = readings[:, 5]
    shown = [rotor[0]]
    for angle in rotor[1:]:
        shown.append(np.clip(shown[-1], angle - 0.1, angle + 0.1))
    readings[:, 5] = shown
    times, readings = times[FEW[name]], readings[FEW[name]]
    with pytest.raises(ValueError, match=r'rotor_5 has an encoder with a play of about 0\.[12]'):
        identify(Readings(times, readings, names=NAMES), Chain())


@pytest.fixture(scope='module')
def clean():
    return identify(Readings(TIMES, READINGS), Chain())


@pytest.mark.parametrize('fraction', [0.0, 0.02])
def test_isolated_wrong_readings_are_counted_and_spoil_nothing(clean, fraction):
    random = np.random.default_rng(5)
    wrong = random.random(READINGS.shape) < fraction
    wrong[60, 6] = True
    readings = READINGS + wrong * random.choice([-1, 1], wrong.shape) * random.uniform(
        0.3, 2.5, wrong.shape
    )
    found = identify(Readings(TIMES, readings), Chain())
    assert found.outliers == pytest.approx(wrong.sum(), rel=0.1)
    for name in ('rotor_lengths', 'spacings', 'rest_lengths'):
        shown, expected = (getattr(each.chain, name) for each in (found, clean))
        spread = found.deviations[name.removesuffix('s')]
        assert np.abs((shown / expected - 1) / spread).max() < 1.0, name


def test_a_spinner_is_identified_from_wrapped_angles_with_gaps():
    made = unequal(SPINNER, 4)
    readings, offsets = read(passage(made), 4)
    readings[np.random.default_rng(5).random(readings.shape) < 0.05] = np.nan
    wrapped = np.angle(np.exp(1j * readings))
    found = identify(Readings(TIMES, wrapped), Chain(spacing=0.2))
    scale = 0.2 / made.spacings.mean()
    assert found.chain.spacings.mean() == pytest.approx(0.2)
    for name in ('rotor_length', 'spacing', 'rest_length'):
        errors = getattr(found.chain, f'{name}s') / (scale * getattr(made, f'{name}s')) - 1
        assert np.sqrt(np.mean((errors / found.deviations[name]) ** 2)) < 1.6, name
    error = np.angle(np.exp(1j * (found.offsets - offsets)))
    assert np.sqrt(np.mean((error / found.offset_deviations) ** 2)) < 1.6
    assert found.rigid


def test_readings_are_weighted_by_their_deviations():
    """A tenth of them have ten times the noise."""
    made = unequal(SPINNER, 4)
    random = np.random.default_rng(6)
    angles = passage(made)
    deviations = np.where(random.random(angles.shape) < 0.1, 0.1, 0.01)
    readings = angles + deviations * random.standard_normal(angles.shape)
    found = identify(Readings(TIMES, readings, deviations), Chain())
    unweighed = split(adjust(readings, initial_lengths(readings)).deviations)
    assert found.noise == pytest.approx(0.01, rel=0.05)
    for name in ('rotor_length', 'spacing', 'rest_length'):
        shown, true = (getattr(each, f'{name}s') for each in (found.chain, made))
        errors = shown / true * made.spacings.mean() / found.chain.spacings.mean() - 1
        assert np.sqrt(np.mean((errors / found.deviations[name]) ** 2)) < 1.6, name
    assert (found.offset_deviations < unweighed[1]).all()


def test_torques_during_a_recording_are_named_as_a_possible_cause_of_its_faults():
    torques = [RecordedImpulse(0.5 + 0.004 * frame) for frame in range(101)]
    swapped = ordered(0, 1, 2, 4, 3, 5, 6, 7, 8, 9)
    for angles, impulses, named in (
        (swapped, torques, True),
        (swapped, [RecordedImpulse(0.5), RecordedImpulse(1.0)], False),
        (resting(), torques, False),
    ):
        with pytest.raises(ValueError, match=r'swap them|nudge the chain') as error:
            identify(Readings(TIMES, angles, None, NAMES, impulses), FLIPPER)
        assert ('torques act for 0.4 s' in str(error.value)) == named
