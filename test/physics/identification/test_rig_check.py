# SPDX-License-Identifier: Apache-2.0
"""The check of a rig names each fault of simulated joint states once, and no other fault."""

from dataclasses import replace

import numpy as np
import pytest

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.identification.rig_bonds import DOUBTFUL, RIGHT, WRONG
from soliton_linkage.identification.rig_check import (
    RigFindings,
    Turn,
    WatchedFrames,
    check_rig,
    first_turn,
    is_at_edge,
    is_resting,
)
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Chain, staggered
from soliton_linkage.linkage.deviations import Deviations

CHAIN = Chain(number_of_rotors=12)
NAMES = [f'rotor_{n}' for n in range(12)]
PERIOD, NOISE = 0.01, 0.003
ONES = np.ones(12)


def turned(rotor: int) -> np.ndarray:
    """Angles of the chain after a hand has turned its edge rotor in the positive direction."""
    lean, edge = (-1, Edge.FIRST) if rotor == 0 else (1, Edge.LAST)
    rest = CHAIN.uniform_state(lean)
    return simulate(CHAIN, rest, 10.0 * edge_mode(CHAIN, rest, edge), 2.0, PERIOD).angles


def frames(angles: np.ndarray, seed: int) -> WatchedFrames:
    random = np.random.default_rng(seed)
    stamps = 1000 + PERIOD * np.arange(len(angles))
    noise = random.normal(0, NOISE, angles.shape)
    return WatchedFrames(stamps, stamps + random.exponential(1e-3, len(angles)), angles + noise)


def at_rest(chain: Chain = CHAIN) -> WatchedFrames:
    return frames(np.tile(chain.uniform_state(-1), (1000, 1)), 0)


def turns() -> list[Turn]:
    hands = [frames(turned(rotor), 1 + rotor) for rotor in (0, 11)]
    return [Turn(rotor, each.angles[0], each) for rotor, each in zip((0, 11), hands, strict=True)]


def changed(change) -> RigFindings:
    """Check the chain whose readings are changed in all frames."""
    watched = replace(at_rest(), angles=change(at_rest().angles))
    hands = [
        hand._replace(
            rest=change(hand.rest[None])[0],
            frames=replace(hand.frames, angles=change(hand.frames.angles)),
        )
        for hand in turns()
    ]
    return check_rig(watched, hands, NAMES, CHAIN)


def not_right(found: RigFindings) -> dict[str, str]:
    """Texts of the findings that are not right, by their subjects, except for omitted steps."""
    return {
        each.subject: each.text
        for each in found.findings
        if not (
            each.verdict == RIGHT
            or (each.subject == 'passage' and each.verdict == DOUBTFUL)
            or 'not turned' in each.text
        )
    }


def test_nothing_is_wrong_with_a_right_rig():
    found = check_rig(at_rest(), turns(), NAMES, CHAIN)
    assert not not_right(found)
    assert found.sound
    assert found.noise == pytest.approx(NOISE * ONES, rel=0.2)
    assert np.abs(found.stretches).max() < 1e-3
    texts = {each.subject: each.text for each in found.findings}
    assert texts['rate'] == '100 frames per second'
    assert texts['order'] == 'rotor_11 turned when you had to turn it'


@pytest.mark.parametrize(
    ('change', 'subject', 'text'),
    [
        (lambda angles: np.rad2deg(angles), 'unit', 'degrees'),
        (lambda angles: -angles, 'sign', 'publish -phi'),
        (lambda angles: angles * (1 - 2 * np.eye(12)[5]), 'chain', 'rotor_5 has the wrong sign'),
        (
            lambda angles: angles + 0.2 * np.eye(12)[5],
            'chain',
            'the reading of rotor_5 is too large by 0.2 rad',
        ),
        (
            lambda angles: angles + np.pi * np.eye(12)[5],
            'chain',
            'rotor_5 is turned by half a turn',
        ),
        (lambda angles: angles + np.pi / 2, 'chain', 'all readings are too large by'),
        (staggered, 'angles', 'pi - phi'),
        (lambda angles: angles[:, [*range(5), 6, 5, *range(7, 12)]], 'chain', 'exchanged'),
        (
            lambda angles: angles[:, [0, 1, 7, *range(3, 7), 2, *range(8, 12)]],
            'chain',
            'rotor_2 and rotor_7 are exchanged',
        ),
        (
            lambda angles: np.where(np.arange(12) == 5, np.nan, angles),
            'rotors',
            'no angle of rotor_5 arrives',
        ),
        (
            lambda angles: np.where(
                np.arange(len(angles))[:, None] % 4 < ONES * 2, angles, np.nan
            ),
            'rotors',
            'missing in up to 50% of the frames',
        ),
        (
            lambda angles: (
                angles + np.random.default_rng(5).normal(0, 0.03, angles.shape) * np.eye(12)[5]
            ),
            'noise',
            'rotor_5 have a noise of up to 0.03 rad',
        ),
    ],
)
def test_a_fault_of_the_readings_is_named_and_no_other(change, subject, text):
    found = not_right(changed(change))
    assert text in found.pop(subject)
    assert not found


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda angles: angles[:, ::-1], 'the joints are in the reverse order: rotor_11 turned'),
        (lambda angles: angles * (1 - 2 * np.eye(12)[0]), 'rotor_0 decreases'),
    ],
)
def test_a_fault_that_turns_and_bonds_show_is_one_line(change, text):
    wrong = [each.text for each in changed(change).findings if each.verdict != RIGHT]
    assert len(wrong) == 1
    assert text in wrong[0]


@pytest.mark.parametrize(('scale', 'verdict'), [(0.9, WRONG), (1.1, WRONG), (1.0, RIGHT)])
def test_a_wrong_rotor_length_that_the_rest_hides_is_seen_when_a_soliton_passes(scale, verdict):
    configured = replace(CHAIN, rotor_length=scale * CHAIN.rotor_length)
    found = {
        each.subject: each for each in check_rig(at_rest(), turns(), NAMES, configured).findings
    }
    assert found['chain'].verdict == RIGHT
    assert found['lengths'].verdict == verdict
    if verdict == WRONG:
        assert 'all rotor lengths differ' in found['lengths'].text
        assert ('+' in found['lengths'].text) == (scale < 1)


def test_rotor_lengths_that_no_motion_shows_are_reported_as_not_checked():
    found = check_rig(at_rest(), [], NAMES, CHAIN).findings
    (lengths,) = (each for each in found if each.subject == 'lengths')
    assert lengths.verdict == DOUBTFUL
    assert 'rotor lengths were not checked' in lengths.text


def test_a_hand_that_turns_no_encoder_is_reported():
    still = Turn(0, CHAIN.uniform_state(-1), at_rest())
    found = not_right(check_rig(at_rest(), [still, turns()[1]], NAMES, CHAIN))
    assert list(found) == ['order']
    assert 'no rotor turned by 0.15 rad when you had to turn rotor_0' in found['order']


@pytest.mark.parametrize('unit', [np.asarray, np.rad2deg])
def test_noise_does_not_count_as_a_motion_in_any_unit(unit) -> None:
    angles = unit(at_rest().angles[:100])
    assert is_resting(angles)
    assert first_turn(angles[0], angles) is None
    noisy = np.random.default_rng(2).normal(0, 0.03, (40, 1)) * np.eye(12)[5]
    assert is_resting(unit(at_rest().angles[:40] + noisy))
    moved = unit(turned(0))
    assert not is_resting(moved)
    assert first_turn(moved[0], moved) == (0, pytest.approx(0.2, abs=0.1))


def test_an_edge_rotor_without_readings_has_no_order() -> None:
    def change(angles: np.ndarray) -> np.ndarray:
        return np.where(np.arange(12) == 0, np.nan, angles)

    assert list(not_right(changed(change))) == ['rotors']


@pytest.mark.parametrize('unit', [np.asarray, np.rad2deg])
def test_a_soliton_at_an_edge_is_found_despite_a_wrong_sign(unit) -> None:
    for lean in (-1, 1):
        angles = CHAIN.uniform_state(lean)
        angles[5] *= -1
        assert is_at_edge(unit(angles), first=True) == (lean < 0)
        assert is_at_edge(unit(angles), first=False) == (lean > 0)


def test_a_soliton_that_a_hand_moves_before_the_request_shows_the_passage() -> None:
    rest, motion = CHAIN.uniform_state(1), turned(0)
    hand = Turn(11, rest, frames(np.tile(rest, (100, 1)), 4), frames(motion, 9))
    found = check_rig(at_rest(), [hand], NAMES, CHAIN)
    assert next(each for each in found.findings if each.subject == 'passage').verdict == RIGHT
    assert 'no rotor turned' in not_right(found)['order']


def test_one_cause_of_an_error_of_half_a_turn_is_named() -> None:
    found = not_right(changed(lambda angles: angles + np.pi * np.eye(12)[5]))
    assert 'too large' not in found['chain']
    assert 'rest length' not in found['chain']


@pytest.mark.parametrize('rotor', [3, 6])
def test_a_rotor_of_another_length_is_named(rotor):
    made = replace(CHAIN, deviations=Deviations(rotor_length=tuple(0.1 * np.eye(12)[rotor])))
    # A simulated chain of the other length, at rest after its motion has been damped.
    made = replace(made, damping=3e-4)
    rest = simulate(made, CHAIN.uniform_state(-1), 0 * ONES, 20.0, 0.1).angles[-1]
    found = not_right(check_rig(frames(np.tile(rest, (500, 1)), 3), [], NAMES, CHAIN))
    assert list(found) == ['chain']
    assert f'the length of rotor_{rotor} differs by +1' in found['chain']


def test_a_wrong_rest_angle_is_one_cause():
    other = replace(CHAIN, rest_angle=CHAIN.rest_angle + 0.15)
    found = not_right(check_rig(at_rest(), [], NAMES, other))
    assert list(found) == ['chain']
    assert 'all rotor lengths or rest lengths differ' in found['chain']


def test_many_wrong_zeros_are_told_as_no_single_cause():
    offsets = np.random.default_rng(7).normal(0, 0.2, 12)
    found = not_right(changed(lambda angles: angles + offsets))
    assert 'no single cause' in found['chain']


def stamped(change, arrive=lambda arrivals: arrivals) -> dict[str, str]:
    watched = at_rest()
    watched = replace(watched, stamps=change(watched.stamps), arrivals=arrive(watched.arrivals))
    return not_right(check_rig(watched, [], NAMES, CHAIN))


def test_dropped_frames_are_counted():
    kept = np.random.default_rng(3).random(1000) > 0.1
    kept[[0, -1]] = True
    watched = at_rest()
    some = WatchedFrames(watched.stamps[kept], watched.arrivals[kept], watched.angles[kept])
    found = not_right(check_rig(some, [], NAMES, CHAIN))
    assert found == {
        'rate': f'100 frames per second, of which {1000 - kept.sum()} of 1000 are missing'
    }


def test_late_frames_are_not_missing() -> None:
    late = at_rest().stamps + 0.9 * PERIOD * (np.arange(1000) % 7 == 3)
    found = check_rig(replace(at_rest(), stamps=late), [], NAMES, CHAIN)
    assert found.findings[0] == (RIGHT, 'rate', '100 frames per second')


def test_the_rate_of_frames_in_bursts_is_their_mean_rate() -> None:
    bursts = 1000 + 0.1 * (np.arange(1000) // 10) + 1e-4 * (np.arange(1000) % 10)
    found = check_rig(replace(at_rest(), stamps=bursts), [], NAMES, CHAIN)
    verdict, _, text = found.findings[0]
    assert verdict == DOUBTFUL
    assert '100.1 frames per second, at irregular times' in text


@pytest.mark.parametrize('jitter', [0.5e-3, 2e-3])
def test_jitter_of_stamps_is_estimated(jitter):
    random = np.random.default_rng(4)
    found = check_rig(
        replace(at_rest(), stamps=at_rest().stamps + random.normal(0, jitter, 1000)),
        [],
        NAMES,
        CHAIN,
    )
    verdict, _, text = next(each for each in found.findings if each.subject == 'jitter')
    assert verdict == (DOUBTFUL if jitter > 1e-3 else RIGHT)
    assert float(text.split(' by ')[1].split()[0]) == pytest.approx(1e3 * jitter, rel=0.15)


@pytest.mark.parametrize(
    ('change', 'subject', 'text'),
    [
        (lambda stamps: np.nan * stamps, 'stamps', 'no stamps'),
        (lambda stamps: np.repeat(stamps[::2], 2), 'stamps', '500 of 1000 stamps are repeated'),
        (
            lambda stamps: stamps[[*range(500), 501, 500, *range(502, 1000)]],
            'stamps',
            '0 of 1000 stamps are repeated and 1 are earlier',
        ),
        (lambda stamps: stamps - 3.0, 'clock', '3 s behind the clock'),
        (lambda stamps: stamps + 3.0, 'clock', '3 s ahead of the clock'),
        (lambda stamps: stamps / 4, 'clock', '0.25 s in a second'),
        (lambda stamps: 0.95 * stamps - 5.0, 'clock', '0.95 s in a second'),
    ],
)
def test_wrong_stamps_are_reported(change, subject, text):
    assert text in stamped(change)[subject]


def test_a_soliton_that_passes_shows_a_wrong_sign_that_the_rest_hides():
    rest, motion = CHAIN.uniform_state(-1), turned(0)
    right = check_rig(at_rest(), [Turn(0, rest, frames(motion, 9))], NAMES, CHAIN)
    assert next(each for each in right.findings if each.subject == 'passage').verdict == RIGHT
    sign = 1 - 2 * np.eye(12)[7]
    watched = replace(at_rest(), angles=sign * at_rest().angles)
    wrong = check_rig(watched, [Turn(0, sign * rest, frames(sign * motion, 9))], NAMES, None)
    verdict, _, text = next(each for each in wrong.findings if each.subject == 'passage')
    assert verdict == WRONG
    assert 'rotor_7 is mounted backwards' in text


def test_a_slow_driver_is_no_wrong_clock() -> None:
    late = stamped(lambda stamps: stamps, lambda arrivals: arrivals + (np.arange(1000) % 9 > 0))
    assert list(late) == ['clock']
    assert 'too slow' in late['clock']


def test_too_few_frames_are_an_error() -> None:
    few = WatchedFrames(np.arange(2.0), np.arange(2.0), np.zeros((2, 12)))
    with pytest.raises(ValueError, match='2 frames are too few'):
        check_rig(few, [], NAMES, CHAIN)


def test_readings_that_do_not_change_at_rest_are_right_and_have_no_noise():
    watched = replace(at_rest(), angles=np.tile(CHAIN.uniform_state(-1), (1000, 1)))
    found = check_rig(watched, [], NAMES, CHAIN)
    noise = next(each for each in found.findings if each.subject == 'noise')
    assert noise.verdict == RIGHT
    assert noise.text == 'the reading of the median rotor does not change at rest'
