# SPDX-License-Identifier: Apache-2.0
"""Collision of a kink and an anti-kink on a ring, and its outcome.

The kink (charge +1, zero energy at rest) comes from the left, the anti-kink (charge -1, positive
rest energy) from the right at the same speed. The ring leans left between the walls, and right
elsewhere. The walls overlap while no rotor leans left. During one collision the walls may overlap
several times, or never. Fields, table columns and settings with the name `collisions` count the
overlaps. Charges alternate along a ring, so that the left wall is the kink after a collision, too.
Only the turns of the rotors between the walls show whether the walls have passed through each
other. The unit of length is the reach of a wall (`Collision.reach`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.dynamics.integrators import INTEGRATORS, SymplecticNystrom
from soliton_linkage.linear.bands import band_edges, penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.solitons.continuum import wall_theory
from soliton_linkage_studies.collisions.travelling_wall import travelling_wall
from soliton_linkage_studies.experiments import energy_per_rotor

INITIAL_DISTANCE = 12.0
"""Initial distance of the walls [reaches], at which their attraction is negligible."""
ESCAPED = 8.0
"""Walls count as escaped if they were nearer than `_NEAR` before and are farther apart than this
[reaches]. At this distance, only walls slower than 0.001 c can still return."""
_NEAR = 7.0
"""The speed before a collision is measured while the walls are farther apart than this
[reaches]."""
_LEAVING = 5.0
"""The speed after a collision is measured while the walls are farther apart than this
[reaches]."""
_FRAMES = 10
"""Number of frames in the time in which sound crosses a reach [1]. Every overlap lasts longer than
this time."""
_CORE = 4.0
"""Energy within this distance of a wall counts as energy of the wall [reaches]."""
_LUMP = 8.0
"""Energy within this distance of the middle of the ring belongs to a captured pair [reaches]."""
_FEWEST = 5
"""Smallest number of frames from which a speed is fitted [1]; escaped walls have 30 or more."""
_TOLERANCE = 1e-10
"""Tolerance of the adaptive integrators [rad]; the relative energy error is then 1e-9."""


@dataclass(frozen=True)
class Collision:
    """Settings of a collision; calling this object simulates the collision."""

    ring: Chain
    speed: float
    """Speed of each wall [speed of sound]."""
    onwards: bool = False
    """Whether the angles phi of a spinner increase from left to right at both walls. Otherwise
    they increase at the kink and decrease by the same amount at the anti-kink."""
    step: float = 1.0
    """Longest integration step, multiplied by the largest angular phonon frequency [1]."""
    integrator: str = 'symplectic'
    shift: float = 0.0
    """Shift of the initial positions of both walls along the ring [rotor spacings]."""
    patience: float = 120.0
    """Extra time that is added to each of two time limits [reach / c]. The first limit counts from
    the start, and ends the simulation if the walls are not nearer than `_NEAR` by then. Without
    extra time, it is the time in which free walls with half of the initial speed would meet. The
    second limit counts from the moment at which the walls are nearer than `_NEAR`. Without extra
    time, it is the time in which free walls would meet with the initial speed and then separate to
    `ESCAPED` with half of this speed."""

    def __call__(self) -> CollisionRun:
        """Simulate the collision until the walls escape or the time limit is reached."""
        path = WallPaths(*np.empty((3, 0)))
        energies: list[float] = []
        for times, angles, rates in simulate_frames(self):
            before = len(path.times)
            path = path.joined(find_walls(self.ring, times, angles))
            last = len(angles) - 1
            end = _end(self, path)
            if end is not None:
                path, last = path.part(slice(end + 1)), end - before
            state = State(angles[last], rates[last])
            energies.append(float(energy_per_rotor(self.ring, state.angles, state.rates).sum()))
            if end is not None:
                break
        return _outcome(self, path, state, drift=float(np.ptp(energies)) / energies[0])

    @property
    def reach(self) -> float:
        """Reach of a wall [rotor spacings]: twice the penetration depth l.

        The tails of a wall decay as e^(-x / l). For the wall width w (`Chain.wall_width`), the
        reach tends to w in flippers with a lean ratio d much smaller than 1, and to 2 w in
        spinners with d much larger than 1.
        """
        return 2 * penetration_depth(self.ring) / self.ring.spacing

    @property
    def sound(self) -> float:
        """Speed of sound [rotor spacings / s]."""
        return speed_of_sound(self.ring) / self.ring.spacing

    @property
    def unit(self) -> float:
        """Time in which sound crosses a reach [s]."""
        return self.reach / self.sound


@dataclass(frozen=True)
class CollisionRun:
    """Outcome of a collision.

    Speeds are divided by the speed of sound c, and lengths by `Collision.reach`.
    """

    escaped: bool
    """Whether the walls met and escaped (see `ESCAPED`). Otherwise they form a captured pair, or
    did not meet before the time limit."""
    collisions: int
    """Number of overlaps."""
    speed_before: float
    """Half of the speed at which the walls approach each other before the collision."""
    kink_speed: float
    """Speed of the kink after the collision, away from the anti-kink; 0 without escape."""
    anti_kink_speed: float
    """Speed of the anti-kink after the collision, away from the kink; 0 without escape."""
    between: float
    """Time between the middles of the first two overlaps [reach / c]; NaN without a second one."""
    closest: float
    """Smallest distance between the walls; 0 if they overlapped."""
    turns: int
    """Number of full turns of the rotors between the walls since the start, positive if their
    angles phi have increased; 0 if the walls have not escaped, or if the ring is no spinner."""
    broken: bool
    """Whether the anti-kink is destroyed at the end. In a spinner, it is destroyed if the walls
    escaped, but the energy within `_CORE` of its position is less than half of the rest energy of
    an anti-kink. In other rings, it is destroyed if a rotor is upside down (cos(theta) < 0 with
    the staggered angle theta, see `staggered`)."""
    radiated: float
    """Fraction of the final energy that is farther than `_CORE` from both walls [1]; without
    escape, the fraction that is farther than `_LUMP` from the middle of the ring."""
    drift: float
    """Largest minus smallest energy during the simulation, divided by the initial energy [1]."""

    @property
    def speed_after(self) -> float:
        """Half of the speed at which the walls move apart after the collision."""
        return (self.kink_speed + self.anti_kink_speed) / 2


@dataclass(frozen=True)
class WallPaths:
    """Paths of both walls, between which the ring leans left; NaN if no rotor leans left."""

    times: Array
    """Times of the frames [s], shape (T,)."""
    kinks: Array
    """Positions of the kink, the left wall [rotor spacings], shape (T,)."""
    anti_kinks: Array
    """Positions of the anti-kink, the right wall [rotor spacings], shape (T,)."""

    @property
    def distances(self) -> Array:
        """Distances between the walls [rotor spacings], shape (T,); NaN during an overlap."""
        return np.asarray(self.anti_kinks - self.kinks)

    def part(self, which: slice) -> WallPaths:
        """Return the paths in the frames `which`."""
        return WallPaths(self.times[which], self.kinks[which], self.anti_kinks[which])

    def joined(self, later: WallPaths) -> WallPaths:
        """Return these paths followed by later paths."""
        pairs = zip(vars(self).values(), vars(later).values(), strict=True)
        return WallPaths(*(np.append(*pair) for pair in pairs))

    def speeds(self) -> Array:
        """Return the fitted velocities of kink and anti-kink [rotor spacings/s].

        Both are NaN for fewer than 5 frames.
        """
        if len(self.times) < _FEWEST:
            return np.full(2, np.nan)
        both = np.stack([self.kinks, self.anti_kinks], axis=1)
        return np.asarray(np.polyfit(self.times, both, 1)[0])


def simulate_frames(task: Collision) -> Iterator[tuple[Array, Array, Array]]:
    """Yield times, angles and rates of the next frame or frames; the iterator never ends.

    The times [s] have shape (T,), the angles [rad] and rates [rad/s] shape (T, N).
    """
    start = initial_state(task)
    motion = EquationOfMotion(task.ring)
    method = INTEGRATORS[task.integrator]
    relative = absolute = _TOLERANCE
    if issubclass(method, SymplecticNystrom):
        # With a large tolerance, the solver always takes the longest allowed step.
        relative, absolute = 0.0, 1e3
    state, longest = motion.state(start.angles, start.rates), task.step / band_edges(task.ring)[1]
    limits = {'rtol': relative, 'atol': absolute, 'max_step': longest}
    solver = method(motion, 0.0, state, np.inf, **limits)
    period, rotors = task.unit / _FRAMES, task.ring.number_of_rotors
    yield np.zeros(1), start.angles[None], start.rates[None]
    while True:
        complaint = solver.step()
        if complaint:
            raise ArithmeticError(f'integration of the ring failed: {complaint}')
        first, last = (math.floor(time / period) for time in (solver.t_old, solver.t))
        if last > first:
            times = period * np.arange(first + 1, last + 1)
            states = solver.dense_output()(times).T
            yield times, states[:, :rotors], states[:, rotors:]


def initial_state(task: Collision) -> State:
    """Return the initial state, in which both walls move towards the middle of the ring.

    Raises ArithmeticError if no travelling wall has the speed of the task.
    """
    ring, velocity = task.ring, task.speed * speed_of_sound(task.ring)
    rotors = np.arange(ring.number_of_rotors, dtype=np.int64)
    kink = travelling_wall(ring, velocity, 1)
    anti_kink = travelling_wall(ring, velocity, -1, -1 if task.onwards else 1)
    middle = (ring.number_of_rotors - 1) / 2 + task.shift
    half = INITIAL_DISTANCE * task.reach / 2
    angles, slopes = kink.at(rotors, middle - half)
    others, other_slopes = anti_kink.at(rotors, middle + half)
    angles = angles + others - anti_kink.angles[rotors % 2, 0]
    return State(angles, (other_slopes - slopes) * velocity / ring.spacing)


def ring_order_field(ring: Chain, angles: Array) -> Array:
    """Return the order field of each rotor, shape (..., N).

    The order field is +1 in the right-leaning rest state and -1 in the left-leaning one.
    """
    theta = staggered(angles)
    if ring.motion is Motion.SPINNER:
        return np.asarray(np.cos(theta - ring.rest_angle))
    return np.asarray(np.sin(theta) / math.sin(ring.rest_angle))


def find_walls(ring: Chain, times: Array, angles: Array) -> WallPaths:
    """Return the paths of both walls, given the angles [rad] in each frame, shape (T, N)."""
    fields = ring_order_field(ring, angles)
    left, last = fields < 0, fields.shape[1] - 1
    before = left.argmax(axis=1) - 1, last - left[:, ::-1].argmax(axis=1)
    crossings = (_crossings(fields, np.clip(rotors, 0, last - 1)) for rotors in before)
    return WallPaths(times, *(np.where(left.any(axis=1), one, np.nan) for one in crossings))


def _crossings(fields: Array, rotors: NDArray[np.int64]) -> Array:
    frame = np.arange(len(fields))
    before, after = fields[frame, rotors], fields[frame, rotors + 1]
    change = np.where(before == after, 1.0, before - after)
    return np.asarray(rotors + before / change)


def _end(task: Collision, path: WallPaths) -> int | None:
    distances = path.distances / task.reach
    met = np.flatnonzero(~(distances > _NEAR))
    if not met.size:
        # If a wall is pinned, the walls never meet, and this time limit ends the run.
        late = path.times > (INITIAL_DISTANCE / task.speed + task.patience) * task.unit
    else:
        there_and_back = (_NEAR / 2 + ESCAPED) / task.speed
        late = path.times - path.times[met[0]] > (task.patience + there_and_back) * task.unit
        late |= (distances > ESCAPED) & (np.arange(len(distances)) > met[0])
    return int(np.argmax(late)) if late.any() else None


def _outcome(task: Collision, path: WallPaths, state: State, drift: float) -> CollisionRun:
    distances = path.distances / task.reach
    near = np.flatnonzero(~(distances > _NEAR))
    escaped = bool(near.size and distances[-1] > ESCAPED)
    overlapping = np.isnan(distances).astype(int)
    begins = np.flatnonzero(np.diff(overlapping, prepend=0) == 1)
    ends = np.flatnonzero(np.diff(overlapping, append=0) == -1)
    middles = [(path.times[k] + path.times[m]) / 2 for k, m in zip(begins, ends, strict=False)]
    before = path.part(slice(int(near[0]) if near.size else None)).speeds() / task.sound
    after = np.zeros(2)
    if escaped:
        inside = np.flatnonzero(~(distances > _LEAVING))
        left = int((inside if inside.size else near)[-1]) + 1
        after = path.part(slice(left, None)).speeds() / task.sound
    return CollisionRun(
        escaped=escaped,
        collisions=len(begins),
        speed_before=float(before[0] - before[1]) / 2,
        kink_speed=-float(after[0]),
        anti_kink_speed=float(after[1]),
        between=float(middles[1] - middles[0]) / task.unit if len(middles) > 1 else math.nan,
        closest=0.0 if len(begins) else float(distances.min()),
        turns=_turns(task.ring, path, state) if escaped else 0,
        broken=_broken(task, path, state, escaped),
        radiated=_radiated(task, path, state, escaped),
        drift=drift,
    )


def _turns(ring: Chain, path: WallPaths, state: State) -> int:
    if ring.motion is not Motion.SPINNER:
        return 0
    rotor = round((path.kinks[-1] + path.anti_kinks[-1]) / 2)
    turned = float(state.angles[rotor] - ring.uniform_state(1)[rotor])
    return round((turned - math.pi) / (2 * math.pi))


def _broken(task: Collision, path: WallPaths, state: State, escaped: bool) -> bool:
    ring = task.ring
    if ring.motion is not Motion.SPINNER:
        return bool((np.cos(staggered(state.angles)) < 0).any())
    near = np.abs(np.arange(ring.number_of_rotors) - path.anti_kinks[-1]) < _CORE * task.reach
    left = float(energy_per_rotor(ring, state.angles, state.rates)[near].sum())
    return escaped and left < wall_theory(ring).energy(0.0, charge=-1) / 2


def _radiated(task: Collision, path: WallPaths, state: State, escaped: bool) -> float:
    rotors = np.arange(task.ring.number_of_rotors)
    energies = energy_per_rotor(task.ring, state.angles, state.rates)
    positions, reach = [path.kinks[-1], path.anti_kinks[-1]], _CORE
    if not escaped:
        positions, reach = [(len(rotors) - 1) / 2], _LUMP
    outside = np.abs(rotors[:, None] - positions).min(axis=1) > reach * task.reach
    return float(energies[outside].sum() / energies.sum())
