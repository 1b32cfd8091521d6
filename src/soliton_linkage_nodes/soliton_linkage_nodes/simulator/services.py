# SPDX-License-Identifier: Apache-2.0
"""The services that pause, step and reset a simulation."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from soliton_linkage.dynamics.initial_states import State
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.messages.conversions import NamedChain, state_from_reset
from soliton_linkage_nodes.simulator.control import SimulationControl
from soliton_linkage_nodes.simulator.world import World


class SimulationServices:
    """Serves `~/pause`, `~/step` and `~/reset` of a simulation; others may call it as well.

    Each method returns None, or why what was asked for cannot be; then nothing was changed.
    """

    def __init__(
        self,
        node: Node,
        named: NamedChain,
        world: World,
        control: SimulationControl,
        period: float,
        most_periods: int,
    ) -> None:
        """Serve; a step takes so many periods [s] at most, the frames that subscribers hold."""
        self.control = control
        self._named = named
        self._world = world
        self._period = period
        self._most_periods = most_periods
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Step, '~/step', self._on_step)
        node.create_service(Reset, '~/reset', self._on_reset)

    def step(self, periods: int) -> str | None:
        """Publish so many frames while paused."""
        if not 1 <= periods <= self._most_periods:
            return (
                f'periods = {periods} must lie in the range 1 to {self._most_periods}, '
                'the frames that a subscriber can hold'
            )
        return self.control.step(periods)

    def reset(self, request: Any) -> str | None:
        """Put the chain into the state of a `Reset.Request`."""
        try:
            self.control.reset(self._state(request))
        except ValueError as error:
            return str(error)
        return None

    def _state(self, request: Any) -> State:
        world = self._world
        if request.state == Reset.Request.INITIAL:
            return world.initial_state()
        if request.state in (Reset.Request.LEFT_LEANING, Reset.Request.RIGHT_LEANING):
            return world.leaning(-1 if request.state == Reset.Request.LEFT_LEANING else 1)
        if request.state == Reset.Request.SOLITON:
            return world.soliton(request.place, request.velocity)
        if request.state == Reset.Request.ANGLES:
            return state_from_reset(self._named, request, self.control.state)
        raise ValueError(f'state = {request.state} must be one of 0 to {Reset.Request.ANGLES}')

    def _on_pause(self, request: Any, response: Any) -> Any:
        complaint = self.control.pause(bool(request.data))
        return _answer(response, complaint, 'paused' if request.data else 'running')

    def _on_step(self, request: Any, response: Any) -> Any:
        complaint = self.step(request.periods)
        reached = self.control.status.frames * self._period
        return _answer(response, complaint, f'reached t = {reached:g} s')

    def _on_reset(self, request: Any, response: Any) -> Any:
        done = {
            Reset.Request.INITIAL: 'in the initial state',
            Reset.Request.LEFT_LEANING: 'at rest, left-leaning',
            Reset.Request.RIGHT_LEANING: 'at rest, right-leaning',
            Reset.Request.SOLITON: (
                f'soliton at rotor {request.place:g} with {request.velocity:g} m/s'
            ),
            Reset.Request.ANGLES: f'{len(request.name)} joints at their angles',
        }
        return _answer(response, self.reset(request), done.get(request.state, ''))


def _answer(response: Any, complaint: str | None, message: str) -> Any:
    response.success = complaint is None
    response.message = complaint or message
    return response
