# SPDX-License-Identifier: Apache-2.0
"""The way of a wall through a chain whose rotors and springs deviate, from rotor to rotor.

A linkage has one freedom: given the angle of one rotor, the seed, all others hang on it bar by
bar. The seed moves more than its neighbours do; where the next one comes to move as much,
|A_n| = |B_n|, that takes over. The side on which rotor n hangs from its right neighbour is then
sign(A_n) as it was when the seed went from n to n + 1, and that on which it hangs from its left
one sign(B_{n-1}) as when the seed came back: neither lever vanishes while the seed is beyond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage.solitons.static_wall import bar_sides, hung_angle, hung_from, static_wall

Numbers = NDArray[np.int64]
Sides = NDArray[np.int8]

_LONGEST_STEP = 0.1
"""Of the angle of a seed, in units of the smaller of rest angle and 1 rad [1]: on it no other
rotor takes over and gives back."""
_SHORTEST_STEP = 1e-10
"""Of the angle of a seed [rad]: below it the bars do not reach on, but for rounding."""
_SURELY = 1e-9
"""Lead from which another rotor takes over [1], above the rounding of a logarithm."""
_FAR_BEHIND = -4.0
"""Lead from which on a side is not followed [1]: no rotor beyond gains a factor e^4 again."""
_MOST_PIECES_A_ROTOR = 20
"""Of a closed path [1]: flippers take about 4 and spinners 2, so that this is an endless one."""


@dataclass(frozen=True)
class SeedPath:
    """Pieces of the orbit in their order along it, each a way past its seed, shape (P,)."""

    seeds: Numbers
    begins: Array
    """Angle of the seed where the piece begins [rad]."""
    ends: Array
    """Angle of the seed where it ends [rad], without jumps."""
    left_sides: Sides
    """Signs of A of the bars seed - beside, ..., seed + beside - 1, shape (P, 2 beside)."""
    right_sides: Sides
    """Signs of B of the same bars; beyond the ends of the chain those of its last bar."""

    def __len__(self) -> int:
        return len(self.seeds)

    def __getitem__(self, which: Numbers) -> SeedPath:
        return SeedPath(
            self.seeds[which],
            self.begins[which],
            self.ends[which],
            self.left_sides[which],
            self.right_sides[which],
        )

    def halves(self) -> SeedPath:
        """Each piece in two."""
        twice = self[np.repeat(np.arange(len(self)), 2)]
        middles = (self.begins + self.ends) / 2
        twice.ends[::2] = middles
        twice.begins[1::2] = middles
        return twice


@dataclass(frozen=True)
class _Bond:
    """The bar to the next rotor, and where that hangs."""

    angle: float
    """Of the rotor that hangs [rad]."""
    near: float
    """Lever of the seed [m], not divided by the length of the bar, as is the other."""
    far: float
    """Lever of the rotor that hangs."""

    @property
    def lead(self) -> float:
        """By how much the rotor that hangs moves more than the seed, log |t_far / t_seed| [1]."""
        if self.near == 0:
            return -math.inf
        return math.log(abs(self.near / self.far)) if self.far else math.inf


class _Seed:
    """The rotor that all others hang on, and the way that it takes."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._last = chain.number_of_rotors - 1
        self._lengths: list[float] = chain.rotor_lengths.tolist()
        self._spacings: list[float] = chain.spacings.tolist()
        self._step = _LONGEST_STEP * min(1.0, chain.rest_angle)
        left, right = bar_sides(chain, 0, False)
        self.left_sides = left.astype(np.int8)
        self.right_sides = right.astype(np.int8)
        self.rotor, self.angle, self.sense = self._start(left, right)

    def _start(self, left: Array, right: Array) -> tuple[int, float, float]:
        """A rotor with the wall on it as without deviations, the nearest to the middle that can.

        Its number, angle and the sense in which it turns as the wall goes on to the last rotor.
        """
        nominal = replace(self._chain, number_of_rotors=8, deviations=NO_DEVIATIONS)
        rotors = np.arange(1, self._last)
        for rotor in rotors[np.argsort(np.abs(rotors - self._last / 2), kind='stable')].tolist():
            angle = float(static_wall(nominal, 2 + rotor % 2)[2 + rotor % 2])
            try:
                angles = hung_from(self._chain, rotor, angle, left, right)
            except ValueError:
                continue
            mode = mode_towards_last(self._chain, angles)
            return rotor, angle, math.copysign(1.0, float(mode[rotor]))
        raise impassable(self._chain, int(self._last // 2))

    def climb(self) -> None:
        """Hand over to rotors that move more until none does."""
        for _ in range(self._last):
            lead, rotor = max(self.lead(towards, self.angle) for towards in (-1, 1))
            if lead <= 0:
                return
            self.hand_over(rotor)

    @property
    def sides(self) -> tuple[bytes, bytes]:
        """Sides on which the rotors on the left and on the right hang."""
        left, right = self.left_sides[: self.rotor], self.right_sides[self.rotor :]
        return left.tobytes(), right.tobytes()

    def lead(self, towards: int, angle: float) -> tuple[float, int]:
        """By how much the rotor that moves most on one side moves more than the seed.

        It is log |t_n / t_seed| [1], with the number n, for the right side (+1) or the left (-1)
        of a seed of an angle [rad]; -inf at the ends.
        """
        rotor, lead = self.rotor, 0.0
        best = -math.inf, rotor
        while lead > _FAR_BEHIND and 0 <= rotor + towards <= self._last:
            bond = self._bond(rotor, towards, angle)
            lead += bond.lead
            rotor, angle = rotor + towards, bond.angle
            best = max(best, (lead, rotor))
        return best

    def _bond(self, rotor: int, towards: int, angle: float) -> _Bond:
        """The bar of a rotor of an angle [rad] to the next one on the right or left."""
        chain, bar, hung = self._chain, min(rotor, rotor + towards), rotor + towards
        side = (self.right_sides if towards > 0 else self.left_sides)[bar]
        spacing = towards * self._spacings[bar]
        hung_at = hung_angle(chain, bar, hung, angle, -spacing, float(side))
        h, v = self._lengths[rotor] * math.sin(angle), self._lengths[rotor] * math.cos(angle)
        h_far = self._lengths[hung] * math.sin(hung_at)
        v_far = self._lengths[hung] * math.cos(hung_at)
        across, up = spacing + h_far - h, v_far - v
        return _Bond(hung_at, h * up - v * across, v_far * across - h_far * up)

    def turn(self, most: float) -> int:
        """Turn by a step, at most so far [rad], or until another rotor takes over.

        Returns the number of the seed from then on. Raises ArithmeticError where the bars do not
        reach further.
        """
        step = min(self._step, most)
        while step > _SHORTEST_STEP:
            beyond = self.angle + self.sense * step
            try:
                leads = [(self.lead(towards, beyond)[0], towards) for towards in (-1, 1)]
            except ValueError:
                step /= 2
                continue
            taken = [towards for lead, towards in leads if lead > _SURELY]
            ends = [(abs(self._even(one, beyond) - self.angle), one) for one in taken]
            if not ends:
                self.angle = beyond
                return self.rotor
            ahead, towards = min(ends)
            self.angle += self.sense * ahead
            return self.lead(towards, self.angle)[1]
        raise ArithmeticError(f'the bars of rotor {self.rotor} do not reach further')

    def _even(self, towards: int, beyond: float) -> float:
        """Angle at which a rotor on a side comes to move as much as the seed [rad]."""

        def lead(angle: float) -> float:
            return self.lead(towards, angle)[0]

        if lead(self.angle) >= 0:
            return self.angle
        return float(brentq(lead, self.angle, beyond, xtol=1e-14))

    def hand_over(self, rotor: int) -> None:
        """Make another rotor the seed."""
        while self.rotor != rotor:
            towards = 1 if rotor > self.rotor else -1
            bond = self._bond(self.rotor, towards, self.angle)
            sides = self.left_sides if towards > 0 else self.right_sides
            sides[min(self.rotor, self.rotor + towards)] = 1 if bond.near > 0 else -1
            self.sense *= -math.copysign(1.0, bond.near * bond.far)
            self.rotor += towards
            self.angle = bond.angle


def seed_path(chain: Chain, beside: int) -> SeedPath:
    """Follow the wall once round its orbit, with the sides of some bars beside each seed.

    It begins in the middle of leg 0. Raises ValueError where the wall does not get through.
    """
    seed = _Seed(chain)
    seed.climb()
    rotor, angle, sides = seed.rotor, seed.angle, seed.sides
    columns = np.arange(-beside, beside)
    rows: list[tuple[int, float, float, Sides, Sides]] = []
    begin, closed = seed.angle, False
    while not closed:
        to_go = math.inf
        if rows and seed.rotor == rotor and seed.sides == sides:
            to_go = seed.sense * (angle - seed.angle) % (2 * math.pi)
        before = seed.angle
        try:
            following = seed.turn(to_go)
        except ArithmeticError:
            raise impassable(chain, seed.rotor) from None
        closed = following == seed.rotor and seed.angle == before + seed.sense * to_go
        if closed or following != seed.rotor:
            bars = np.clip(columns + seed.rotor, 0, chain.number_of_springs - 1)
            rows.append(
                (seed.rotor, begin, seed.angle, seed.left_sides[bars], seed.right_sides[bars])
            )
            seed.hand_over(following)
            begin = seed.angle
        astray = abs(seed.angle - begin) > 2 * math.pi
        if astray or len(rows) > _MOST_PIECES_A_ROTOR * chain.number_of_rotors:
            raise impassable(chain, seed.rotor)
    seeds, begins, ends, left, right = zip(*rows, strict=True)
    return SeedPath(
        np.array(seeds), np.array(begins), np.array(ends), np.array(left), np.array(right)
    )


def impassable(chain: Chain, rotor: int) -> ValueError:
    """Error that says where the wall does not get through."""
    reason = 'lower the deviations of the chain'
    obstacles = find_obstacles(chain)
    if obstacles:
        nearest = min(obstacles, key=lambda each: abs(each.bond + 0.5 - rotor))
        reason = (
            f'the spring of bond {nearest.bond}, {nearest.rest_length:.6g} m, {nearest.reason}'
        )
        reason += '; lower the deviations of the chain there'
    return ValueError(
        f'a wall does not get past rotor {rotor} of 0 to {chain.number_of_rotors - 1} as it does '
        f'without deviations: {reason}'
    )
