# SPDX-License-Identifier: Apache-2.0
"""Checks of the joint states of a rig: stamps, noise, order, signs and bond lengths at rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.mounting import MOST_NAMED, check_unit, in_radians, listed
from soliton_linkage.identification.readings import interpolated
from soliton_linkage.identification.screening import check_motion, leaning_over, noise_by_rotor
from soliton_linkage.linkage.chain import Array, Chain, staggered, wrapped

RIGHT, DOUBTFUL, WRONG = 'right', 'doubtful', 'wrong'
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
_LARGEST_STRETCH = 0.02
"""Largest acceptable stretch of a bond, the relative difference of its apparent from its
configured length [1]. An encoder zero error of 0.05 rad causes a larger stretch."""
_LARGEST_OFFSET = 2.9
"""Largest zero error that is tried as a cause of stretches [rad]; half turns are tried, too."""
_LARGEST_CHANGE = 0.3
"""Relative errors of lengths up to this are tried as the cause of the stretches [1]."""
_EXPLAINED = 1 / 3
"""A correction explains stretches if it reduces their root mean square below this fraction [1]."""
_EQUALLY_GOOD = 1.5
"""Besides the best correction, for example of a sign, others are reported if they leave a root
mean square stretch smaller than this times the stretch that the best one leaves [1]."""
_MOST_AGAINST = 0.2
"""A soliton is at an edge if at most this fraction of the rotors leans away from that edge [1]."""
_ALSO_IN_MOTION = {'rotors', 'order', 'sign', 'chain'}
"""Subjects whose faults also change the motion, which shows the cause less certainly."""
_NO_CAUSE = 'no single cause explains this'
_MOST_FRAMES = 200
"""Largest number of frames from which the stretches are computed [1]."""


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


class RigFinding(NamedTuple):
    """Result of one check."""

    verdict: str
    subject: str
    text: str


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
    if chain is not None and _is_staggered(chain, interpolated(watched.angles)):
        text = 'odd rotors have the staggered angle; publish pi - phi for them'
        findings.append(RigFinding(WRONG, 'angles', text))
        watched, turns = _converted(staggered, watched, turns)
    angles = interpolated(watched.angles)
    seen = np.isfinite(watched.angles).mean(axis=0)
    findings += _missing_findings(seen, names)
    noise = noise_by_rotor(angles)
    findings += _noise_findings(noise, names)
    findings += _turn_findings(turns, names)
    stretches = np.full(len(names) - 1, np.nan)
    if chain is not None:
        bonds = _Bonds(chain, angles)
        stretches = bonds.stretches(bonds.angles)
        findings += _chain_findings(bonds, names)
    everything = [
        watched,
        *(each for turn in turns for each in (turn.before, turn.frames) if each),
    ]
    passed = np.concatenate([each.angles for each in everything])
    named = {
        each.subject for each in findings if each.verdict == WRONG and _NO_CAUSE not in each.text
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


def _turn_findings(turns: Sequence[Turn], names: Sequence[str]) -> Iterator[RigFinding]:
    for rotor in {0, len(names) - 1} - {turn.rotor for turn in turns}:
        text = f'{names[rotor]} was not turned by hand, so that its order and sign are unknown'
        yield RigFinding(DOUBTFUL, 'order', text)
    for turn in turns:
        if np.isnan(turn.rest[turn.rotor]):
            continue
        found = first_turn(turn.rest, turn.frames.angles)
        asked = names[turn.rotor]
        if found is None:
            text = (
                f'no rotor turned by {SMALLEST_TURN:g} rad when you had to turn {asked}: turn it '
                'further, or check the cable and the magnet of its encoder; if the soliton is at '
                'the other edge, all signs are wrong: publish -phi'
            )
            yield RigFinding(WRONG, 'order', text)
            continue
        rotor, step = found
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


class _Bonds:
    def __init__(self, chain: Chain, angles: Array) -> None:
        self.angles = angles[:: -(-len(angles) // _MOST_FRAMES)]
        self._pivots, self._lengths = chain.pivots, chain.rotor_lengths
        self._rest = chain.rest_lengths[: chain.number_of_rotors - 1]

    def stretches(self, angles: Array, rotor_scale: float | Array = 1.0) -> Array:
        """Return the median stretch of each bond over all frames [1], (N - 1,)."""
        lengths = self._lengths * rotor_scale
        x = self._pivots + lengths * np.sin(angles)
        apart = np.hypot(np.diff(x, axis=1), np.diff(lengths * np.cos(angles), axis=1))
        return np.asarray(np.median(apart / self._rest - 1, axis=0))

    def _shifted(self, rotors: float | Array, step: float) -> Array:
        return self.stretches(self.angles - step * rotors)

    def _lengthened(self, rotors: float | Array, step: float) -> Array:
        return self.stretches(self.angles, 1 + step * rotors)

    def corrections(self, names: Sequence[str]) -> Iterator[tuple[Array, str]]:
        angles, ones = self.angles, np.eye(len(names))
        yield self.stretches(angles[:, ::-1]), 'the joints are in the reverse order'
        common, value = _fitted(partial(self._shifted, 1.0), np.pi)
        yield common, f'all readings are too large by {value:.2g} rad'
        for n, one in enumerate(ones):
            yield self.stretches(angles * (1 - 2 * one)), f'{names[n]} has the wrong sign: -phi'
            yield self.stretches(angles - np.pi * one), f'{names[n]} is turned by half a turn'
        for n, other in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[n, other]] = other, n
            text = f'{names[n]} and {names[other]} are exchanged'
            yield self.stretches(angles[:, order]), text
        for n, one in enumerate(ones):
            found, value = _fitted(partial(self._shifted, one), _LARGEST_OFFSET)
            yield found, f'the reading of {names[n]} is too large by {value:.2g} rad'
            found, value = _fitted(partial(self._lengthened, one), _LARGEST_CHANGE)
            yield found, f'the length of {names[n]} differs by {value:+.1%}'
        found, value = _fitted(partial(self._lengthened, 1.0), _LARGEST_CHANGE)
        yield found, f'all rotor lengths or rest lengths differ, rotors by {value:+.1%}'
        now = self.stretches(angles)
        for n in np.flatnonzero(~(np.abs(now) > _LARGEST_CHANGE)).tolist():
            text = f'the rest length of the bond {names[n]} to {names[n + 1]} differs by'
            yield now * (1 - np.eye(len(now))[n]), f'{text} {now[n]:+.1%}'


def _is_staggered(chain: Chain, angles: Array) -> bool:
    bonds = _Bonds(chain, angles)
    now, other = (_size(bonds.stretches(each)) for each in (bonds.angles, staggered(bonds.angles)))
    return now > _LARGEST_STRETCH and other < _EXPLAINED * now


def _size(stretches: Array) -> float:
    known = stretches[np.isfinite(stretches)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def _fitted(stretches: Callable[[float], Array], largest: float) -> tuple[Array, float]:
    grid = np.linspace(-largest, largest, 25)
    best = grid[np.argmin([_size(stretches(float(value))) for value in grid])]
    step = grid[1] - grid[0]
    near = max(best - step, -largest), min(best + step, largest)
    found = minimize_scalar(lambda value: _size(stretches(value)), bounds=near, method='bounded')
    return stretches(float(found.x)), float(found.x)


def _chain_findings(bonds: _Bonds, names: Sequence[str]) -> Iterator[RigFinding]:
    now = bonds.stretches(bonds.angles)
    if not np.isfinite(now).any():
        return
    largest = float(np.nanmax(np.abs(now)))
    if largest < _LARGEST_STRETCH:
        text = f'all bonds fit the configured chain; the largest difference is {largest:.2%}'
        yield RigFinding(RIGHT, 'chain', text)
        return
    n = int(np.nanargmax(np.abs(now)))
    text = f'the bond {names[n]} to {names[n + 1]} differs by {now[n]:+.1%} from the chain'
    corrected = bonds.corrections(names)
    sizes = [(_size(np.where(np.isnan(to), now, to)), cause) for to, cause in corrected]
    least = max(min(size for size, _ in sizes), _LARGEST_STRETCH / 10)
    if least < _EXPLAINED * _size(now):
        causes = [cause for size, cause in sizes if size < _EQUALLY_GOOD * least]
        yield RigFinding(WRONG, 'chain', f'{text}: {"; or ".join(causes[:MOST_NAMED])}')
        return
    count = int(np.nansum(np.abs(now) > _LARGEST_STRETCH))
    text += (
        f', and {count} bonds by more than {_LARGEST_STRETCH:.0%}; {_NO_CAUSE}: '
        'set the zeros of the encoders, and measure spacing, rotor length and rest angle'
    )
    yield RigFinding(WRONG, 'chain', text)


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
