# SPDX-License-Identifier: Apache-2.0
"""Checks of the joint states of a rig: stamps, noise, order, signs and bond lengths at rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.mounting import check_unit, in_radians, listed
from soliton_linkage.identification.readings import interpolated
from soliton_linkage.identification.rig_bonds import (
    DOUBTFUL,
    NO_CAUSE,
    RIGHT,
    WRONG,
    Bonds,
    RigFinding,
    chain_findings,
    is_staggered,
    length_findings,
    size_of,
)
from soliton_linkage.identification.screening import check_motion, leaning_over, noise_by_rotor
from soliton_linkage.linkage.chain import Array, Chain, staggered, wrapped

SMALLEST_TURN = 0.15
"""Smallest rotation that counts as a turn by hand [rad]; encoder noise is far smaller."""
_LARGEST_JITTER = 1e-3
"""Largest acceptable jitter of stamps [s]; at 10 rad/s, it acts like a noise of 0.01 rad."""
_LARGEST_AGE = 0.5
"""Largest acceptable age of a frame at its arrival [s]."""
_LARGEST_LEAD = 0.01
"""Largest time by which a stamp may be in the future [s]; NTP clocks differ by less."""
_LARGEST_SLOWNESS = 0.02
"""Largest acceptable relative error of the speed at which stamps advance [1]."""
_LATE = 1.5
"""Intervals longer than this times the median [1] are not jitter: a frame is late or missing."""
_COUNTED_FRAMES = 10
"""Missing frames are counted in blocks of this many frames, from the duration of each block."""
_LARGEST_NOISE = 0.05
"""Largest acceptable noise of a reading [rad]."""
_NOISE_RANGE = 5.0
"""Range of 40 readings at rest, divided by their noise [1]; the mean of this ratio is 4.3."""
_NOISY = 3.0
"""A rotor counts as noisy if its noise is larger than this times the median noise [1]."""
_SMALLEST_NOISE = 2e-3
"""No rotor with a smaller noise than this counts as noisy [rad]."""
_LEAST_SEEN = 0.99
"""Smallest acceptable fraction of the frames in which a rotor has a reading [1]."""
_NO_WORSE = 0.01
"""Readings are corrected for a fault that turns by hand show, unless the correction increases the
root mean square stretch by more than this [1]."""
_MOST_AGAINST = 0.2
"""A soliton is at an edge if at most this fraction of the rotors leans away from that edge [1]."""
_ALSO_IN_MOTION = {'rotors', 'order', 'sign', 'chain'}
"""Subjects whose faults also change the motion, which shows the cause less certainly."""


@dataclass(frozen=True)
class WatchedFrames:
    """Joint states in T frames of N rotors, in the order of their arrival."""

    stamps: Array
    """Stamps [s], shape (T,); NaN if a frame has no stamp."""
    arrivals: Array
    """Times of arrival [s], on the clock of the stamps, shape (T,)."""
    angles: Array
    """Readings [rad], NaN if missing, (T, N)."""


class Turn(NamedTuple):
    """Frames recorded after the request to turn a rotor by hand in the positive direction."""

    rotor: int
    rest: Array
    """Readings just before the request [rad], (N,)."""
    frames: WatchedFrames
    before: WatchedFrames | None = None
    """Frames before the request, while a hand moved the soliton."""


@dataclass(frozen=True)
class RigFindings:
    """Results of the check of a rig with N rotors."""

    findings: tuple[RigFinding, ...]
    noise: Array
    """Noise of each rotor [rad], (N,); NaN if unknown."""
    stretches: Array
    """Ratio of apparent to configured bond length, minus 1 [1], (N - 1,); NaN if unknown."""

    @property
    def sound(self) -> bool:
        """Whether no check has found a fault."""
        return all(each.verdict != WRONG for each in self.findings)


def check_rig(
    watched: WatchedFrames, turns: Sequence[Turn], names: Sequence[str], chain: Chain | None
) -> RigFindings:
    """Check frames of a resting rig, and turns by hand; raise ValueError for too few frames."""
    if len(watched.stamps) < 4:
        raise ValueError(f'{len(watched.stamps)} frames are too few to check a rig; publish more')
    findings = [*_stamp_findings(watched)]
    try:
        check_unit(watched.angles)
        findings.append(RigFinding(RIGHT, 'unit', 'the angles are in radians'))
    except ValueError as error:
        findings.append(RigFinding(WRONG, 'unit', str(error)))
        watched, turns = _converted(np.deg2rad, watched, turns)
    if chain is not None and is_staggered(chain, interpolated(watched.angles)):
        text = 'odd rotors have the staggered angle; publish pi - phi for them'
        findings.append(RigFinding(WRONG, 'angles', text))
        watched, turns = _converted(staggered, watched, turns)
    angles = interpolated(watched.angles)
    seen = np.isfinite(watched.angles).mean(axis=0)
    findings += _missing_findings(seen, names)
    noise = noise_by_rotor(angles)
    findings += _noise_findings(noise, names)
    findings += _turn_findings(turns, names)
    everything = [
        watched,
        *(each for turn in turns for each in (turn.before, turn.frames) if each),
    ]
    passed = np.concatenate([each.angles for each in everything])
    stretches = np.full(len(names) - 1, np.nan)
    if chain is not None:
        bonds, correct = Bonds(chain, angles), _correction(turns, len(names))
        stretches = bonds.stretches(bonds.angles)
        corrected = Bonds(chain, correct(angles))
        fits = size_of(corrected.stretches(corrected.angles)) < size_of(stretches) + _NO_WORSE
        if fits:
            bonds, passed = corrected, correct(passed)
        found = list(chain_findings(bonds, names))
        findings += found
        if fits and all(each.verdict == RIGHT for each in found):
            findings += length_findings(bonds, interpolated(passed), names)
    named = {
        each.subject for each in findings if each.verdict == WRONG and NO_CAUSE not in each.text
    }
    findings += _passage_findings(passed, names, bool(named & _ALSO_IN_MOTION))
    return RigFindings(tuple(findings), noise, stretches)


def is_resting(angles: Array) -> bool:
    """Return whether all rotors are at rest in all frames of readings [rad], shape (T, N)."""
    readings = interpolated(in_radians(angles, angles[-1]))
    ranges = np.ptp(readings, axis=0) - _NOISE_RANGE * noise_by_rotor(readings)
    return not bool((ranges > SMALLEST_TURN / 2).any())


def is_at_edge(angles: Array, first: bool) -> bool:
    """Return whether a frame, (N,), shows a soliton at the edge: the `first` or the last one."""
    leans = np.sin(in_radians(angles, angles))
    against = int((leans > 0).sum() if first else (leans < 0).sum())
    return against <= max(1, _MOST_AGAINST * len(angles))


def first_turn(rest: Array, angles: Array) -> tuple[int, float] | None:
    """Return the rotor that turns first from `rest` [rad], (N,), and its rotation [rad], or None.

    Only rotations above `SMALLEST_TURN` count. Of several in one frame, the largest is the first.
    """
    turned = np.nan_to_num(wrapped(in_radians(angles - rest, rest)))
    frames = np.flatnonzero(np.abs(turned).max(axis=1, initial=0.0) > SMALLEST_TURN)
    if not frames.size:
        return None
    rotor = int(np.argmax(np.abs(turned[frames[0]])))
    return rotor, float(turned[frames[0], rotor])


def _converted(
    convert: Callable[[Array], Array], watched: WatchedFrames, turns: Sequence[Turn]
) -> tuple[WatchedFrames, list[Turn]]:
    def frames(given: WatchedFrames) -> WatchedFrames:
        return replace(given, angles=convert(given.angles))

    return frames(watched), [
        turn._replace(
            rest=convert(turn.rest),
            frames=frames(turn.frames),
            before=turn.before and frames(turn.before),
        )
        for turn in turns
    ]


def _stamp_findings(frames: WatchedFrames) -> Iterator[RigFinding]:
    stamps, arrivals = frames.stamps, frames.arrivals
    elapsed = float(arrivals[-1] - arrivals[0])
    if np.isnan(stamps).any():
        yield RigFinding(WRONG, 'rate', f'{len(stamps) / elapsed:.3g} frames per second arrive')
        text = (
            'frames have no stamps; stamp each frame with the time of its measurement, or set the '
            'parameter stamps of soliton_analyser to arrival'
        )
        yield RigFinding(WRONG, 'stamps', text)
        return
    intervals = np.diff(stamps)
    repeated, backward = int((intervals == 0).sum()), int((intervals < 0).sum())
    intervals = intervals[intervals > 0]
    period = float(np.median(intervals)) if len(intervals) else elapsed / len(stamps)
    missing = _missing_frames(stamps, period) if not (repeated or backward) else 0
    rate = f'{1 / period:.4g} frames per second'
    if missing > len(stamps):
        rate = f'{len(stamps) / elapsed:.4g} frames per second, at irregular times; measure at '
        rate += 'equal intervals'
    elif missing:
        rate += f', of which {missing} of {len(stamps) + missing} are missing'
    yield RigFinding(DOUBTFUL if missing else RIGHT, 'rate', rate)
    if repeated or backward:
        text = (
            f'{repeated} of {len(stamps)} stamps are repeated and {backward} are earlier than the '
            'stamp before; publish each frame once, in the order of the stamps'
        )
        yield RigFinding(WRONG, 'stamps', text)
    yield _jitter_finding(intervals[intervals < _LATE * period] - period)
    yield _clock_finding(stamps, arrivals)


def _jitter_finding(lateness: Array) -> RigFinding:
    jitter = robust_deviation(np.abs(lateness)) / np.sqrt(2)
    steady = jitter < _LARGEST_JITTER
    remedy = '; measure at equal intervals, and stamp frames where they are measured'
    text = f'the stamps jitter by {round(1e3 * jitter, 3):.3g} ms{"" if steady else remedy}'
    return RigFinding(RIGHT if steady else DOUBTFUL, 'jitter', text)


def _clock_finding(stamps: Array, arrivals: Array) -> RigFinding:
    ages = arrivals - stamps
    # In the first and in the last third, the frame of the smallest age is not delayed.
    third = len(ages) // 3
    youngest = [int(np.argmin(ages[:third])), int(np.argmin(ages[-third:])) - third]
    speed = float(np.diff(stamps[youngest])[0] / np.diff(arrivals[youngest])[0])
    age, least = float(np.median(ages)), float(ages.min())
    state = DOUBTFUL
    if abs(speed - 1) > _LARGEST_SLOWNESS:
        text = (
            f'the stamps advance by {speed:.3g} s in a second of the clock: a simulator or a bag '
            'player does not run in real time, or the clock of the stamps is wrong'
        )
    elif age > _LARGEST_AGE > least:
        text = (
            f'frames arrive {age:.3g} s after their stamps, the fastest one {least:.3g} s: the '
            'driver or this machine is too slow; publish fewer frames'
        )
    elif not -_LARGEST_LEAD < age < _LARGEST_AGE:
        state, side = WRONG, 'behind' if age > 0 else 'ahead of'
        text = (
            f'the stamps are {abs(age):.3g} s {side} the clock of this machine; synchronise the '
            'clocks, for example by NTP; restart a simulator that was slower than real time'
        )
    else:
        state, text = RIGHT, f'frames arrive {1e3 * age:.3g} ms after their stamps'
    return RigFinding(state, 'clock', text)


def _missing_frames(stamps: Array, period: float) -> int:
    ends = np.minimum(
        np.arange(0, len(stamps) + _COUNTED_FRAMES, _COUNTED_FRAMES), len(stamps) - 1
    )
    total = np.rint(np.diff(stamps[ends]) / period) - np.diff(ends)
    return max(int(total.sum()), 0)


def _missing_findings(seen: Array, names: Sequence[str]) -> Iterator[RigFinding]:
    absent = [names[n] for n in np.flatnonzero(seen == 0).tolist()]
    some = (seen > 0) & (seen < _LEAST_SEEN)
    gaps = [names[n] for n in np.flatnonzero(some).tolist()]
    if absent:
        text = f'no angle of {listed(absent)} arrives; publish all rotors, or set joint_names'
        yield RigFinding(WRONG, 'rotors', text)
    if gaps:
        text = f'{listed(gaps)} are missing in up to {1 - seen[some].min():.0%} of the frames'
        yield RigFinding(DOUBTFUL, 'rotors', text)
    if not (absent or gaps):
        yield RigFinding(RIGHT, 'rotors', f'all {len(names)} rotors have readings')


def _noise_findings(noise: Array, names: Sequence[str]) -> Iterator[RigFinding]:
    known = np.isfinite(noise)
    if not known.any():
        return
    usual = float(np.median(noise[known]))
    loud = np.nan_to_num(noise) > max(_NOISY * usual, _SMALLEST_NOISE)
    noisy = np.flatnonzero(loud | (np.nan_to_num(noise) > _LARGEST_NOISE)).tolist()
    if noisy:
        text = (
            f'{listed([names[n] for n in noisy])} have a noise of up to '
            f'{np.max(noise[noisy]):.2g} rad, the median rotor {usual:.2g} rad; check the cables, '
            'magnets and supplies'
        )
        yield RigFinding(DOUBTFUL, 'noise', text)
    else:
        text = f'the noise of the median rotor is {usual:.2g} rad'
        steady = 'the reading of the median rotor does not change at rest'
        yield RigFinding(RIGHT, 'noise', text if usual else steady)


def _turned_rotors(turns: Sequence[Turn]) -> dict[int, tuple[int, float]]:
    """Return the rotor that turned, and its rotation [rad], for each rotor that had to turn."""
    found = {turn.rotor: first_turn(turn.rest, turn.frames.angles) for turn in turns}
    return {asked: each for asked, each in found.items() if each}


def _is_reversed(turned: dict[int, tuple[int, float]], rotors: int) -> bool:
    return {asked: rotor for asked, (rotor, _) in turned.items()} == {0: rotors - 1, rotors - 1: 0}


def _correction(turns: Sequence[Turn], rotors: int) -> Callable[[Array], Array]:
    """Return a function that corrects the order and the signs in readings, (T, N)."""
    turned, signs = _turned_rotors(turns), np.ones(rotors)
    for asked, (rotor, step) in turned.items():
        if asked == rotor and step < 0:
            signs[rotor] = -1
    order = slice(None, None, -1 if _is_reversed(turned, rotors) else 1)
    return lambda angles: signs * angles[:, order]


def _turn_findings(turns: Sequence[Turn], names: Sequence[str]) -> Iterator[RigFinding]:
    for rotor in {0, len(names) - 1} - {turn.rotor for turn in turns}:
        text = f'{names[rotor]} was not turned by hand, so that its order and sign are unknown'
        yield RigFinding(DOUBTFUL, 'order', text)
    turned = _turned_rotors(turns)
    if _is_reversed(turned, len(names)):
        text = (
            f'the joints are in the reverse order: {names[-1]} turned when you had to turn '
            f'{names[0]}, and {names[0]} when you had to turn {names[-1]}; name the joints from '
            'rotor 0 to the last'
        )
        yield RigFinding(WRONG, 'order', text)
        return
    for turn in turns:
        if np.isnan(turn.rest[turn.rotor]):
            continue
        asked = names[turn.rotor]
        if turn.rotor not in turned:
            text = (
                f'no rotor turned by {SMALLEST_TURN:g} rad when you had to turn {asked}: turn it '
                'further, or check the cable and the magnet of its encoder; if the soliton is at '
                'the other edge, all signs are wrong: publish -phi'
            )
            yield RigFinding(WRONG, 'order', text)
            continue
        rotor, step = turned[turn.rotor]
        if rotor != turn.rotor:
            text = f'{names[rotor]} turned by {step:+.2g} rad when you had to turn {asked}'
            yield RigFinding(WRONG, 'order', f'{text}; name the joints from rotor 0 to the last')
            continue
        yield RigFinding(RIGHT, 'order', f'{asked} turned when you had to turn it')
        if step < 0:
            text = (
                f'{asked} decreases when it turns in the positive direction; publish -phi for it, '
                'or set its entry of encoders.signs to -1'
            )
            yield RigFinding(WRONG, 'sign', text)
        else:
            yield RigFinding(RIGHT, 'sign', f'{asked} increases in the positive direction')


def _passage_findings(angles: Array, names: Sequence[str], known: bool) -> Iterator[RigFinding]:
    readings = interpolated(angles)
    if len(names) < 4 or not np.isfinite(readings).all():
        return
    verdict, text = RIGHT, 'a soliton passed, and all rotors moved like neighbours'
    try:
        if leaning_over(readings)[1:-1].all():
            check_motion(readings, names)
        else:
            verdict = DOUBTFUL
            text = (
                'no soliton passed all rotors during this check; record one, and identify_chain '
                'checks zeros, signs and order of the inner rotors'
            )
    except ValueError as error:
        later = 'a soliton passed, but the faults above also change the motion; check again later'
        verdict, text = (DOUBTFUL, later) if known else (WRONG, str(error))
    yield RigFinding(verdict, 'passage', text)
