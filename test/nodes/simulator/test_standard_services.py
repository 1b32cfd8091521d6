# SPDX-License-Identifier: Apache-2.0
"""The services of simulation_interfaces act like the simulator's own, with standard codes.

The package of the standard may not be installed: classes with its constants and fields stand in.
"""

from types import SimpleNamespace
from typing import Any

from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.simulator.control import SimulationStatus
from soliton_linkage_nodes.simulator.services import StandardServices

FEATURES = (
    'SIMULATION_RESET',
    'SIMULATION_RESET_STATE',
    'SIMULATION_STATE_GETTING',
    'SIMULATION_STATE_SETTING',
    'SIMULATION_STATE_PAUSE',
    'STEP_SIMULATION_SINGLE',
    'STEP_SIMULATION_MULTIPLE',
)
MESSAGES = SimpleNamespace(
    Result=SimpleNamespace(
        RESULT_FEATURE_UNSUPPORTED=0,
        RESULT_OK=1,
        RESULT_INCORRECT_STATE=3,
        RESULT_OPERATION_FAILED=4,
    ),
    SimulationState=SimpleNamespace(
        STATE_STOPPED=0, STATE_PLAYING=1, STATE_PAUSED=2, STATE_QUITTING=3
    ),
    SimulatorFeatures=SimpleNamespace(**{name: k for k, name in enumerate(FEATURES, 20)}),
)
TYPES = SimpleNamespace(
    SetSimulationState=SimpleNamespace(Response=SimpleNamespace(ALREADY_IN_TARGET_STATE=101)),
    ResetSimulation=SimpleNamespace(
        Request=SimpleNamespace(SCOPE_DEFAULT=0, SCOPE_TIME=1, SCOPE_STATE=2, SCOPE_SPAWNED=4)
    ),
)
STOPPED, PLAYING, PAUSED, QUITTING = 0, 1, 2, 3
UNSUPPORTED, OK, FAILED, ALREADY = 0, 1, 4, 101


class Services:
    """Replacement of the simulator's own services and their simulation."""

    def __init__(self) -> None:
        self.control = self
        self.paused = False
        self.frames = 10
        self.resets: list[int] = []
        self.complaint: str | None = None

    @property
    def status(self) -> SimulationStatus:
        return SimulationStatus(self.frames, 0, self.paused, None, 0.0, 0.0, 0.0)

    def pause(self, paused: bool) -> str | None:
        self.paused = paused
        return self.complaint

    def step(self, periods: int) -> str | None:
        self.frames += periods
        return self.complaint

    def reset(self, request: Any) -> str | None:
        self.resets.append(request.state)
        return self.complaint


class Client:
    def __init__(self) -> None:
        self.services = Services()
        self.standard = StandardServices(self.services, MESSAGES, TYPES)

    def call(self, service: str, **request: Any) -> Any:
        response = SimpleNamespace(
            result=SimpleNamespace(result=None, error_message=''),
            state=SimpleNamespace(state=None),
            features=SimpleNamespace(features=None),
        )
        return getattr(self.standard, service)(SimpleNamespace(**request), response)

    @property
    def state(self) -> int:
        response = self.call('get_simulation_state')
        assert response.result.result == OK
        return response.state.state

    def put(self, state: int) -> Any:
        return self.call('set_simulation_state', state=SimpleNamespace(state=state)).result


def test_the_features_are_those_that_there_are():
    response = Client().call('get_simulator_features')
    assert response.features.features == list(range(20, 27))


def test_it_plays_and_pauses():
    client = Client()
    assert client.state == PLAYING
    for state in (PAUSED, PLAYING, PAUSED):
        assert client.put(state).result == OK
        assert client.state == state
        assert client.services.paused == (state == PAUSED)
        assert client.put(state).result == ALREADY
    assert client.services.resets == []


def test_to_stop_is_to_pause_and_reset_until_something_moves():
    client = Client()
    assert client.put(STOPPED).result == OK
    assert client.services.resets == [Reset.Request.INITIAL]
    assert client.services.paused
    assert client.state == STOPPED
    client.services.step(1)
    assert client.state == PAUSED
    assert client.put(STOPPED).result == OK
    assert client.put(PAUSED).result == OK
    assert client.state == PAUSED
    client.put(STOPPED)
    assert client.put(PLAYING).result == OK
    assert client.state == PLAYING


def test_it_does_not_quit():
    client = Client()
    result = client.put(QUITTING)
    assert result.result == UNSUPPORTED
    assert 'state = 3 must be playing, paused or stopped' in result.error_message
    assert client.state == PLAYING


def test_it_steps():
    client = Client()
    client.put(PAUSED)
    assert client.call('step_simulation', steps=7).result.result == OK
    assert client.services.frames == 17


def test_it_resets_the_state_but_not_the_time():
    for scope, result in [
        (2, OK),
        (6, OK),
        (0, UNSUPPORTED),
        (1, UNSUPPORTED),
        (4, UNSUPPORTED),
        (255, UNSUPPORTED),
    ]:
        client = Client()
        response = client.call('reset_simulation', scope=scope)
        assert response.result.result == result
        assert client.services.resets == [Reset.Request.INITIAL] * (result == OK)
        assert ('request SCOPE_STATE = 2' in response.result.error_message) == (result != OK)


def test_impossible_requests_are_rejected_with_a_reason():
    client = Client()
    client.services.complaint = 'pause it first'
    for result in (
        client.call('step_simulation', steps=1).result,
        client.call('reset_simulation', scope=2).result,
        client.put(PAUSED),
    ):
        assert (result.result, result.error_message) == (FAILED, 'pause it first')
