# SPDX-License-Identifier: Apache-2.0
"""A simulation that several threads share: one lets it go on, others command it."""

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
from soliton_linkage_nodes.runtime.guarded import in_one_line

_LONGEST_TRIAL = 1.0
"""Of the first frame after a reset, in time of the processor [s], for which the caller waits."""
_LEAST_PROGRESS = 1e-3
"""Share of a frame that must be computed in that time [1]: one that takes a quarter of an hour is
refused."""
_MOST_KICKS = 10_000
"""Kicks that may wait for a frame: a second of the fastest topic, and no lasting growth."""


@dataclass(frozen=True)
class SimulationStatus:
    """How a simulation is doing."""

    frames: int
    """Frames published."""
    pending: int
    """Commands that wait for the next frame."""
    paused: bool
    failure: str | None
    """Why it cannot go on before a reset."""
    energy: float
    """Of the current frame [J]."""
    energy_drift: float
    """Energy gained or lost by the solver, over the largest there was [1]."""
    dissipated: float
    """Energy that the damping has taken out since the last reset [J]."""


@dataclass
class _Pending:
    """What waits for the next frame."""

    kicks: list[Array] = field(default_factory=list)
    torques: Array | None = None
    count: int = 0


class SimulationControl:
    """Publishes the frames of a simulation one by one, and what is commanded comes in between.

    A command acts at the instant of the frame that is published next: each of the kicks that
    wait for it, of torques and of gravity the latest. The frame shows the rates right after the
    kicks. Torques are dropped `command_timeout` [s] of simulated time after that frame, unless
    it is 0. Where the next frame cannot be computed, the simulation is paused until it is reset.

    A frame of a wild or a long chain takes seconds to compute. Only `step` waits for it.
    """

    def __init__(
        self,
        begin: Callable[[State, Gravity], Simulation],
        state: State,
        gravity: Gravity,
        command_timeout: float,
        publish: Callable[[int, Simulation], None],
        tell: Callable[[int, Array], None] = lambda frame, impulses: None,
    ) -> None:
        """Begin in a state; `publish` takes each frame's number and the simulation at it.

        `tell` takes before that the sum of the impulses that act at its instant [N m s].
        """
        self._begin = begin
        self._gravity = gravity
        self._publish, self._tell = publish, tell
        self._lock = threading.Lock()
        self._frame_in_work = threading.Lock()
        self._stopping = False
        self._paused = False
        self._failure: str | None = None
        self._commands = _Pending()
        self._torques_expire: int | None = None
        self._frame = 0
        self._given_up: Simulation | None = None
        self._simulation = begin(state, gravity)
        self._timeout = 0
        if command_timeout:
            self._timeout = max(round(command_timeout / self._simulation.period), 1)

    @property
    def status(self) -> SimulationStatus:
        """How the simulation is doing."""
        with self._lock:
            return SimulationStatus(
                self._frame,
                self._commands.count,
                self._paused,
                self._failure,
                self._simulation.energy,
                self._simulation.energy_drift,
                self._simulation.dissipated,
            )

    @property
    def simulation(self) -> Simulation:
        """The simulation since the last reset; look at it only while it is paused."""
        return self._simulation

    @property
    def state(self) -> State:
        """Angles and rates of the frame that is published next."""
        with self._lock:
            return State(self._simulation.angles, self._simulation.rates)

    def tick(self) -> bool:
        """Publish the current frame, commands first, and go on to the next; False if paused."""
        with self._frame_in_work:
            if self._given_up is self._simulation:
                self._finish_frame(self._simulation)
            with self._lock:
                if self._paused or self._stopping:
                    return False
                simulation = self._begin_frame()
            self._finish_frame(simulation)
            return True

    def kick(self, impulses: Array) -> str | None:
        """Apply angular impulses [N m s], shape (N,); return why that cannot be."""
        with self._lock:
            if len(self._commands.kicks) >= _MOST_KICKS:
                return f'{_MOST_KICKS} kicks wait for the next frame already; let time go on'
            self._commands.kicks.append(impulses)
            self._commands.count += 1
            return None

    def hold(self, torques: Array) -> None:
        """Apply torques [N m], shape (N,), until told otherwise or until the time is over."""
        with self._lock:
            self._commands.torques = torques
            self._commands.count += 1

    def turn_gravity(self, gravity: Gravity) -> None:
        """Let gravity be another, after a reset too."""
        with self._lock:
            self._gravity = gravity

    def pause(self, paused: bool) -> str | None:
        """Pause at once or go on; return why that cannot be."""
        with self._lock:
            if not paused and self._failure is not None:
                return self._failure
            self._paused = paused
            return None

    def step(self, periods: int) -> str | None:
        """Publish so many frames while paused; return why that cannot be."""
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
        """Drop all commands and put the chain into a state; time goes on.

        Raises ValueError, with nothing changed, where the mechanics do not allow the state or no
        frame can be computed from it.
        """
        simulation = self._begin(state, self._gravity)
        _try(simulation)
        with self._lock:
            self._simulation = simulation
            self._commands = _Pending()
            self._torques_expire = None
            if self._failure is not None:
                self._failure, self._paused = None, False

    def stop(self) -> None:
        """Give up the frame that is being computed and publish no other until it goes on."""
        self._stopping = True

    def go_on(self) -> None:
        """Go on after a stop, with the frame that was given up."""
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
        """Go on to the next frame, with the lock free until that is computed."""
        failure: Exception | None = None
        self._given_up = simulation
        try:
            while not (simulation.ready or self._failure or self._forsaken(simulation)):
                simulation.step()
        except Exception as error:
            failure = error
        with self._lock:
            if self._failure is None and not self._forsaken(simulation):
                try:
                    if failure is None:
                        simulation.advance()
                except Exception as error:
                    failure = error
                self._given_up = None
                if failure is not None:
                    self._fail(failure)

    def _forsaken(self, simulation: Simulation) -> bool:
        return self._stopping or simulation is not self._simulation

    def _fail(self, error: Exception) -> None:
        self._paused = True
        expected = isinstance(error, (ArithmeticError, ValueError))
        self._failure = f'{error if expected else in_one_line(error)}; call ~/reset to go on'

    def _carry_out_commands(self) -> None:
        simulation = self._simulation
        commands, self._commands = self._commands, _Pending()
        simulation.turn_gravity(self._gravity)
        for impulses in commands.kicks:
            simulation.kick(impulses)
        if commands.kicks:
            self._tell(self._frame, np.sum(commands.kicks, axis=0))
        if commands.torques is not None:
            simulation.hold(commands.torques)
            self._torques_expire = self._frame + self._timeout if self._timeout else None
        if self._torques_expire is not None and self._frame >= self._torques_expire:
            simulation.hold(0 * simulation.torques)
            self._torques_expire = None


def _try(simulation: Simulation) -> None:
    """Compute the first frame, or as much as there is time for; ValueError where it cannot be."""
    deadline = time.thread_time() + _LONGEST_TRIAL
    try:
        while not simulation.ready and time.thread_time() < deadline:
            simulation.step()
    except ArithmeticError as error:
        raise ValueError(str(error)) from error
    if 0 < simulation.progress < _LEAST_PROGRESS:
        raise ValueError(
            f'a frame of this state takes {_LONGEST_TRIAL / _LEAST_PROGRESS:g} s to compute or '
            f'more, and {simulation.steps_a_frame:.3g} steps at least; start from slower rotors, '
            'or from softer springs and heavier masses'
        )
