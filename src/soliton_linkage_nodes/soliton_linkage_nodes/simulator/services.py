# SPDX-License-Identifier: Apache-2.0
"""Services that pause, step and reset a simulation: of this suite and of simulation_interfaces."""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from soliton_linkage.dynamics.initial_states import State, leaning, with_soliton
from soliton_linkage.dynamics.world import World
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.messages.conversions import NamedChain, state_from_reset
from soliton_linkage_nodes.simulator.control import SimulationControl

_STANDARD_FEATURES = (
    *('SIMULATION_RESET', 'SIMULATION_RESET_STATE', 'SIMULATION_STATE_GETTING'),
    *('SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE'),
    *('STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE'),
)


class SimulationServices:
    """Services `~/pause`, `~/step` and `~/reset` of a simulation.

    `step` and `reset` return the reason of a rejection, or None. A rejected request has no effect.
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
        """Create the services. A step has at most `most_periods` frames, each of `period` [s]."""
        self.control = control
        self._named = named
        self._world = world
        self._period = period
        self._most_periods = most_periods
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Step, '~/step', self._on_step)
        node.create_service(Reset, '~/reset', self._on_reset)

    def step(self, periods: int) -> str | None:
        """Publish `periods` frames of the paused simulation."""
        if not 1 <= periods <= self._most_periods:
            return (
                f'periods = {periods} must lie in the range 1 to {self._most_periods}, '
                'the frames that a subscriber can hold'
            )
        return self.control.step(periods)

    def reset(self, request: Any) -> str | None:
        """Put the chain into the state that a `Reset.Request` describes."""
        try:
            self.control.reset(self._state(request))
        except ValueError as error:
            return str(error)
        return None

    def _state(self, request: Any) -> State:
        chain = self._named.chain
        if request.state == Reset.Request.INITIAL:
            return self._world.initial_state()
        if request.state in (Reset.Request.LEFT_LEANING, Reset.Request.RIGHT_LEANING):
            return leaning(chain, -1 if request.state == Reset.Request.LEFT_LEANING else 1)
        if request.state == Reset.Request.SOLITON:
            return with_soliton(chain, request.rotor, request.velocity)
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
                f'soliton at rotor {request.rotor:g} with {request.velocity:g} m/s'
            ),
            Reset.Request.ANGLES: f'{len(request.name)} joints at their angles',
        }
        return _answer(response, self.reset(request), done.get(request.state, ''))


def _answer(response: Any, complaint: str | None, message: str) -> Any:
    response.success = complaint is None
    response.message = complaint or message
    return response


def serve_standard(node: Node, services: SimulationServices) -> StandardServices | None:
    """Create the services of simulation_interfaces; None if this package is not installed."""
    try:
        messages = importlib.import_module('simulation_interfaces.msg')
        types = importlib.import_module('simulation_interfaces.srv')
    except ImportError:
        return None
    standard = StandardServices(services, messages, types)
    for name, callback in (
        ('GetSimulatorFeatures', standard.get_simulator_features),
        ('GetSimulationState', standard.get_simulation_state),
        ('SetSimulationState', standard.set_simulation_state),
        ('StepSimulation', standard.step_simulation),
        ('ResetSimulation', standard.reset_simulation),
    ):
        node.create_service(getattr(types, name), f'~/{callback.__name__}', callback)
    return standard


class StandardServices:
    """Services of the package simulation_interfaces, which pause, step and reset the simulation.

    A request for the state "stopped" pauses and resets the simulation. The reported state is then
    "stopped" until the simulation continues ("playing") or a step publishes a frame ("paused").
    """

    def __init__(self, services: SimulationServices, messages: Any, types: Any) -> None:
        self._services = services
        self._control = services.control
        self._messages = messages
        self._types = types
        self._stopped_at: int | None = None

    def get_simulator_features(self, _request: Any, response: Any) -> Any:
        """Return the features of simulation_interfaces that this node supports."""
        known = self._messages.SimulatorFeatures
        response.features.features = [getattr(known, name) for name in _STANDARD_FEATURES]
        return response

    def get_simulation_state(self, _request: Any, response: Any) -> Any:
        """Return whether the simulation is playing, paused or stopped."""
        response.state.state = self._state()
        return self._answered(response, None)

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Continue, pause or stop the simulation, as the request demands."""
        known, wanted = self._messages.SimulationState, request.state.state
        if wanted not in (known.STATE_PLAYING, known.STATE_PAUSED, known.STATE_STOPPED):
            reason = f'state = {wanted} must be playing, paused or stopped'
            return self._unsupported(response, reason)
        if wanted == self._state():
            codes = self._types.SetSimulationState.Response
            response.result.result = codes.ALREADY_IN_TARGET_STATE
            return response
        complaint = self._control.pause(wanted != known.STATE_PLAYING)
        self._stopped_at = None
        if wanted == known.STATE_STOPPED:
            complaint = self._services.reset(Reset.Request(state=Reset.Request.INITIAL))
            self._control.pause(True)
            self._stopped_at = self._control.status.frames
        return self._answered(response, complaint)

    def step_simulation(self, request: Any, response: Any) -> Any:
        """Publish the requested number of frames of the paused simulation."""
        return self._answered(response, self._services.step(request.steps))

    def reset_simulation(self, request: Any, response: Any) -> Any:
        """Put the chain into its initial state; reject a request that also resets the time."""
        scopes = self._types.ResetSimulation.Request
        if request.scope not in (scopes.SCOPE_STATE, scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED):
            reason = (
                f'scope = {request.scope} must include the state and exclude the time, which '
                f'never decreases; request SCOPE_STATE = {scopes.SCOPE_STATE}'
            )
            return self._unsupported(response, reason)
        complaint = self._services.reset(Reset.Request(state=Reset.Request.INITIAL))
        return self._answered(response, complaint)

    def _state(self) -> int:
        known, status = self._messages.SimulationState, self._control.status
        if not status.paused:
            return int(known.STATE_PLAYING)
        stopped = self._stopped_at == status.frames
        return int(known.STATE_STOPPED if stopped else known.STATE_PAUSED)

    def _answered(self, response: Any, complaint: str | None) -> Any:
        known = self._messages.Result
        failed = complaint is not None
        response.result.result = known.RESULT_OPERATION_FAILED if failed else known.RESULT_OK
        response.result.error_message = complaint or ''
        return response

    def _unsupported(self, response: Any, complaint: str) -> Any:
        response.result.result = self._messages.Result.RESULT_FEATURE_UNSUPPORTED
        response.result.error_message = complaint
        return response
