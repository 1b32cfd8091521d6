# SPDX-License-Identifier: Apache-2.0
"""Control of a simulation, which one thread advances while other threads send commands."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage_nodes.runtime.guarded import describe_error

_LEAST_PROGRESS = 1e-3
"""Smallest fraction of the first frame interval that a reset must simulate within the processor
time `longest_trial` of `SimulationControl` [1]. Otherwise, the reset is rejected."""
_MOST_KICKS = 10_000
"""Largest number of kicks that may wait for the next frame [1], about as many as can arrive in 1
s."""


@dataclass(frozen=True)
class SimulationStatus:
    """State of a simulation."""

    frames: int
    """Number of published frames."""
    pending: int
    """Number of commands that wait for the next frame."""
    paused: bool
    failure: str | None
    """Error that has paused the simulation until a reset, or None."""
    energy: float
    """Energy of the current frame [J]."""
    energy_drift: float
    """Energy that errors of the solver have added since the last reset, divided by the largest
    energy since then [1]. Negative values mean a loss."""
    dissipated: float
    """Energy dissipated by the damping since the last reset [J]."""


@dataclass
class _Pending:
    kicks: list[Array] = field(default_factory=list)
    torques: Array | None = None
    count: int = 0


class SimulationControl:
    """Simulation that publishes one frame after the other and applies commands in between.

    All waiting kicks, the latest torques and the latest gravity act from the time of the next
    published frame. The angular velocities in this frame include the effect of the kicks. If the
    next frame cannot be computed, the simulation pauses until a reset. Other threads may call all
    methods except `tick`. A call of `step` may take seconds.
    """

    def __init__(
        self,
        begin: Callable[[State, Gravity], Simulation],
        state: State,
        gravity: Gravity,
        command_timeout: float,
        publish: Callable[[int, Simulation], None],
        announce: Callable[[int, Array], None] = lambda frame, impulses: None,
        longest_trial: float = 1.0,
    ) -> None:
        """Create a simulation that starts in the state `state`.

        `begin` creates a simulation from a state and the gravity. Torques end after the simulated
        time `command_timeout` [s]; 0 means no limit. For every frame, `publish` is called with the
        frame number and the simulation. If kicks act at a frame, `announce` is called before
        `publish`, with the frame number and the sum of their impulses [N m s], shape (N,). To test
        a new state, a reset simulates its first frame interval for at most `longest_trial` [s] of
        processor time.
        """
        self._begin = begin
        self._gravity = gravity
        self._simulation = begin(state, gravity)
        self._non_reciprocity = self._simulation.chain.non_reciprocity
        self._publish, self._announce = publish, announce
        self._longest_trial = longest_trial
        self._lock = threading.Lock()
        self._frame_in_work = threading.Lock()
        self._stopping = False
        self._paused = False
        self._failure: str | None = None
        self._commands = _Pending()
        self._torques_expire: int | None = None
        self._frame = 0
        self._abandoned: Simulation | None = None
        self._timeout = 0
        if command_timeout:
            self._timeout = max(round(command_timeout / self._simulation.period), 1)

    @property
    def status(self) -> SimulationStatus:
        """State of the simulation."""
        with self._lock:
            simulation = self._simulation
            energies = simulation.energy, simulation.energy_drift, simulation.dissipated
            state = self._frame, self._commands.count, self._paused, self._failure
            return SimulationStatus(*state, *energies)

    @property
    def simulation(self) -> Simulation:
        """Simulation since the last reset. Read it only while the simulation is paused."""
        return self._simulation

    @property
    def state(self) -> State:
        """State of the chain in the next frame to be published."""
        with self._lock:
            return State(self._simulation.angles, self._simulation.rates)

    def tick(self) -> bool:
        """Apply commands, publish a frame, compute the next; return False if paused or stopped."""
        with self._frame_in_work:
            if self._abandoned is self._simulation:
                self._finish_frame(self._simulation)
            with self._lock:
                if self._paused or self._stopping:
                    return False
                simulation = self._begin_frame()
            self._finish_frame(simulation)
            return True

    def kick(self, impulses: Array) -> str | None:
        """Apply impulses [N m s], shape (N,), at the next frame; return the reason if rejected."""
        with self._lock:
            if len(self._commands.kicks) >= _MOST_KICKS:
                return f'{_MOST_KICKS} kicks already wait for the next frame; wait for a frame'
            self._commands.kicks.append(impulses)
            self._commands.count += 1
            return None

    def hold(self, torques: Array) -> None:
        """Apply torques [N m], shape (N,), until others replace them or `command_timeout` ends."""
        with self._lock:
            self._commands.torques = torques
            self._commands.count += 1

    def set_gravity(self, gravity: Gravity) -> None:
        """Set the gravity that acts from the next frame on. Resets do not change it."""
        with self._lock:
            self._gravity = gravity

    def set_non_reciprocity(self, value: float) -> None:
        """Set the parameter `Chain.non_reciprocity` [N m/rad] from the next frame on.

        It is the torque of each bond on both of its rotors, per difference of their coordinates.
        Resets do not change it.
        """
        with self._lock:
            self._non_reciprocity = value

    def pause(self, paused: bool) -> str | None:
        """Pause immediately, or end the pause; return the reason of a rejection, or None."""
        with self._lock:
            if not paused and self._failure is not None:
                return self._failure
            self._paused = paused
            return None

    def step(self, periods: int) -> str | None:
        """Publish `periods` frames of the paused simulation; return the reason of a failure."""
        if self._stopping:
            return 'the simulation is stopped; activate the simulator first'
        if not self._paused:
            return 'the simulation is running; pause it before stepping'
        with self._frame_in_work:
            for _ in range(periods):
                if self._failure is not None or self._stopping:
                    break
                with self._lock:
                    simulation = self._begin_frame()
                self._finish_frame(simulation)
            return self._failure

    def reset(self, state: State) -> None:
        """Put the chain into a state, and drop waiting commands. The simulated time continues.

        Raises ValueError and changes nothing if the mechanics do not allow the state, or if the
        simulation of the first frame interval fails or is too slow.
        """
        simulation = self._begin(state, self._gravity)
        simulation.set_non_reciprocity(self._non_reciprocity)
        _try(simulation, self._longest_trial)
        with self._lock:
            self._simulation = simulation
            self._commands = _Pending()
            self._torques_expire = None
            if self._failure is not None:
                self._failure, self._paused = None, False

    def stop(self) -> None:
        """Interrupt the computation of a frame. No frame is published until `resume` is called."""
        self._stopping = True

    def resume(self) -> None:
        """Continue after `stop` with the computation that was interrupted."""
        self._stopping = False

    def _begin_frame(self) -> Simulation:
        try:
            self._carry_out_commands()
        except Exception as error:
            self._fail(error)
        self._publish(self._frame, self._simulation)
        self._frame += 1
        return self._simulation

    def _finish_frame(self, simulation: Simulation) -> None:
        """Compute the next frame. Other threads can send commands meanwhile."""
        failure: Exception | None = None
        self._abandoned = simulation
        try:
            while not (simulation.ready or self._failure or self._abandons(simulation)):
                simulation.step()
        except Exception as error:
            failure = error
        with self._lock:
            if self._failure is None and not self._abandons(simulation):
                try:
                    if failure is None:
                        simulation.advance()
                except Exception as error:
                    failure = error
                self._abandoned = None
                if failure is not None:
                    self._fail(failure)

    def _abandons(self, simulation: Simulation) -> bool:
        return self._stopping or simulation is not self._simulation

    def _fail(self, error: Exception) -> None:
        self._paused = True
        expected = isinstance(error, (ArithmeticError, ValueError))
        self._failure = f'{error if expected else describe_error(error)}; call ~/reset to continue'

    def _carry_out_commands(self) -> None:
        simulation = self._simulation
        commands, self._commands = self._commands, _Pending()
        simulation.set_gravity(self._gravity)
        simulation.set_non_reciprocity(self._non_reciprocity)
        for impulses in commands.kicks:
            simulation.kick(impulses)
        if commands.kicks:
            self._announce(self._frame, np.sum(commands.kicks, axis=0))
        if commands.torques is not None:
            simulation.hold(commands.torques)
            self._torques_expire = self._frame + self._timeout if self._timeout else None
        if self._torques_expire is not None and self._frame >= self._torques_expire:
            simulation.hold(0 * simulation.torques)
            self._torques_expire = None


def _try(simulation: Simulation, limit: float) -> None:
    """Simulate the first frame interval of a new state for at most `limit` [s] of processor time.

    Raises ValueError if the simulation fails, or if less than 0.001 of the interval is simulated
    within `limit`. If more than this but not the whole interval is simulated, `tick` continues.
    """
    deadline = time.thread_time() + limit
    try:
        while not simulation.ready and time.thread_time() < deadline:
            simulation.step()
    except ArithmeticError as error:
        raise ValueError(str(error)) from error
    if 0 < simulation.progress < _LEAST_PROGRESS:
        raise ValueError(
            f'a frame of this state takes {limit / _LEAST_PROGRESS:g} s or more '
            f'to compute, and at least {simulation.steps_per_frame:.3g} steps; start from slower '
            'rotors, or from softer springs and heavier masses'
        )
