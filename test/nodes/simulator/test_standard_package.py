# SPDX-License-Identifier: Apache-2.0
"""Where the package of the standard is installed, the simulator serves its types."""

import pytest

from soliton_linkage_nodes.simulator.node import Simulator

reason = 'needs simulation_interfaces: run make test-interfaces'
messages = pytest.importorskip('simulation_interfaces.msg', reason=reason)
types = pytest.importorskip('simulation_interfaces.srv', reason=reason)


def test_the_standard_services_pause_step_reset_and_report(graph):
    graph.start(Simulator, {'chain.number_of_rotors': 4, 'publish_rate': 50.0})
    features = graph.call(types.GetSimulatorFeatures, 'simulator/get_simulator_features').features
    assert messages.SimulatorFeatures.STEP_SIMULATION_MULTIPLE in features.features
    paused = messages.SimulationState(state=messages.SimulationState.STATE_PAUSED)
    for expected in (
        messages.Result.RESULT_OK,
        types.SetSimulationState.Response.ALREADY_IN_TARGET_STATE,
    ):
        answer = graph.call(
            types.SetSimulationState, 'simulator/set_simulation_state', state=paused
        )
        assert answer.result.result == expected
    told = graph.call(types.GetSimulationState, 'simulator/get_simulation_state').state
    assert told.state == messages.SimulationState.STATE_PAUSED
    done = graph.call(types.StepSimulation, 'simulator/step_simulation', steps=3)
    assert done.result.result == messages.Result.RESULT_OK
    reset = graph.call(
        types.ResetSimulation,
        'simulator/reset_simulation',
        scope=types.ResetSimulation.Request.SCOPE_STATE,
    )
    assert reset.result.result == messages.Result.RESULT_OK
