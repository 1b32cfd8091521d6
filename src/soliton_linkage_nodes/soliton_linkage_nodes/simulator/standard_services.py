# SPDX-License-Identifier: Apache-2.0
"""The services of the package simulation_interfaces, where that is installed."""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.node import Node

from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.simulator.services import SimulationServices

_PACKAGE = 'simulation_interfaces'


def serve_standard(node: Node, services: SimulationServices) -> StandardServices | None:
    """Serve the standard's services beside a node's own; None where the package is not there."""
    try:
        messages = importlib.import_module(f'{_PACKAGE}.msg')
        types = importlib.import_module(f'{_PACKAGE}.srv')
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
    """Answers the standard's requests by the services that pause, step and reset.

    Stopped is a simulation that is paused in its initial state since it was asked to stop.
    """

    def __init__(self, services: SimulationServices, messages: Any, types: Any) -> None:
        """Answer in the modules of messages and services of the standard."""
        self._services = services
        self._control = services.control
        self._messages = messages
        self._types = types
        self._stopped_at: int | None = None

    def get_simulator_features(self, _request: Any, response: Any) -> Any:
        """Say what there is of the standard."""
        known = self._messages.SimulatorFeatures
        response.features.features = [
            known.SIMULATION_RESET,
            known.SIMULATION_RESET_STATE,
            known.SIMULATION_STATE_GETTING,
            known.SIMULATION_STATE_SETTING,
            known.SIMULATION_STATE_PAUSE,
            known.STEP_SIMULATION_SINGLE,
            known.STEP_SIMULATION_MULTIPLE,
        ]
        return response

    def get_simulation_state(self, _request: Any, response: Any) -> Any:
        """Say whether it is playing, paused or stopped."""
        response.state.state = self._state()
        return self._answered(response, None)

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Play, pause, or stop, which is to pause and reset."""
        known, wanted = self._messages.SimulationState, request.state.state
        if wanted not in (known.STATE_PLAYING, known.STATE_PAUSED, known.STATE_STOPPED):
            return self._unsupported(
                response, f'state = {wanted} must be playing, paused or stopped'
            )
        if wanted == self._state():
            response.result.result = (
                self._types.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
            )
            return response
        complaint = self._control.pause(wanted != known.STATE_PLAYING)
        self._stopped_at = None
        if wanted == known.STATE_STOPPED:
            complaint = self._services.reset(Reset.Request(state=Reset.Request.INITIAL))
            self._control.pause(True)
            self._stopped_at = self._control.status.frames
        return self._answered(response, complaint)

    def step_simulation(self, request: Any, response: Any) -> Any:
        """Publish so many frames while paused."""
        return self._answered(response, self._services.step(request.steps))

    def reset_simulation(self, request: Any, response: Any) -> Any:
        """Put the chain into its initial state; the time cannot be reset."""
        scopes = self._types.ResetSimulation.Request
        if request.scope not in (scopes.SCOPE_STATE, scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED):
            return self._unsupported(
                response,
                f'scope = {request.scope} includes the time, which never runs backwards, or not '
                f'the state; ask for SCOPE_STATE = {scopes.SCOPE_STATE}',
            )
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
