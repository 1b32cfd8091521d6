# SPDX-License-Identifier: Apache-2.0
"""A simulation that several threads share: one lets it go on, others command it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from soliton_linkage.chain import Array, Chain
from soliton_linkage.elastic_simulation import ElasticSimulation


@dataclass(frozen=True)
class Status:
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


class SimulationControl:
    """Publishes the frames of a simulation one by one, and what is commanded comes in between.

    A command acts at the instant of the frame that is published next, right after it. Torques
    are dropped `command_timeout` [s] of simulated time after they came, unless that is 0. Where
    the next frame cannot be computed, the simulation is paused until it is reset.

    A frame of a wild or a long chain takes seconds to compute. Only `step` waits for it.
    """

    def __init__(
        self,
        chain: Chain,
        lean: int,
        rate: float,
        tolerance: float,
        command_timeout: float,
        publish: Callable[[int, ElasticSimulation], None],
    ) -> None:
        """Start at rest in a uniform state; `publish` takes each frame's number and state."""
        self._chain = chain
        self._rate = rate
        self._tolerance = tolerance
        self._timeout = max(round(command_timeout * rate), 1) if command_timeout else None
        self._publish = publish
        self._lock = threading.Lock()
        self._frame_in_work = threading.Lock()
        self._stopping = False
        self._commands: list[Callable[[], None]] = []
        self._paused = False
        self._failure: str | None = None
        self._torques_expire: int | None = None
        self._frame = 0
        self._simulation = self._at_rest(lean)

    @property
    def status(self) -> Status:
        """How the simulation is doing."""
        with self._lock:
            return Status(
                self._frame,
                len(self._commands),
                self._paused,
                self._failure,
                self._simulation.energy,
                self._simulation.energy_drift,
            )

    def tick(self) -> None:
        """Publish the current frame, obey the commands and go on to the next, unless paused."""
        with self._frame_in_work:
            with self._lock:
                if self._paused or self._stopping:
                    return
                simulation = self._begin_frame()
            self._finish_frame(simulation)

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,)."""
        self._command(lambda: self._simulation.kick(impulses))

    def hold(self, torques: Array) -> None:
        """Apply torques [N m], shape (N,), until told otherwise or until the time is over."""
        self._command(lambda: self._hold(torques))

    def pause(self, paused: bool) -> str | None:
        """Pause at once or go on; return why that cannot be."""
        with self._lock:
            if not paused and self._failure is not None:
                return self._failure
            self._paused = paused
            return None

    def step(self, periods: int) -> str | None:
        """Publish so many frames while paused; return why that cannot be."""
        if not self._paused:
            return 'the simulation is running; pause it before stepping'
        with self._frame_in_work:
            for _ in range(periods):
                if self._failure is not None:
                    break
                with self._lock:
                    simulation = self._begin_frame()
                self._finish_frame(simulation)
            return self._failure

    def reset(self, lean: int) -> None:
        """Drop all commands and put the chain at rest in a uniform state; time goes on."""
        with self._lock:
            self._commands.clear()
            self._torques_expire = None
            if self._failure is not None:
                self._failure, self._paused = None, False
            self._simulation = self._at_rest(lean)

    def stop(self) -> None:
        """Give up the frame that is being computed and publish no other."""
        self._stopping = True

    def _command(self, command: Callable[[], None]) -> None:
        with self._lock:
            self._commands.append(command)

    def _begin_frame(self) -> ElasticSimulation:
        self._publish(self._frame, self._simulation)
        try:
            self._obey()
        except ValueError as error:
            self._fail(error)
        self._frame += 1
        return self._simulation

    def _finish_frame(self, simulation: ElasticSimulation) -> None:
        """Go on to the next frame, with the lock free until that is computed."""
        failure = None
        try:
            while not (simulation.ready or self._failure or self._forsaken(simulation)):
                simulation.step()
        except ArithmeticError as error:
            failure = error
        with self._lock:
            if self._failure is None and not self._forsaken(simulation):
                if failure is None:
                    simulation.advance()
                else:
                    self._fail(failure)

    def _forsaken(self, simulation: ElasticSimulation) -> bool:
        return self._stopping or simulation is not self._simulation

    def _fail(self, error: Exception) -> None:
        self._paused = True
        self._failure = f'{error}; call ~/reset to go on'

    def _obey(self) -> None:
        commands, self._commands = self._commands, []
        for command in commands:
            command()
        if self._torques_expire is not None and self._frame >= self._torques_expire:
            self._simulation.hold(0 * self._simulation.torques)
            self._torques_expire = None

    def _hold(self, torques: Array) -> None:
        self._simulation.hold(torques)
        self._torques_expire = None if self._timeout is None else self._frame + self._timeout

    def _at_rest(self, lean: int) -> ElasticSimulation:
        return ElasticSimulation(
            self._chain,
            self._chain.uniform_state(lean),
            period=1 / self._rate,
            tolerance=self._tolerance,
        )
