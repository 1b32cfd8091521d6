# SPDX-License-Identifier: Apache-2.0
"""Every node can be configured, activated, deactivated and cleaned up from outside, always."""

from typing import Any, ClassVar

import numpy as np
import pytest
from graphs import Graph
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import TransitionCallbackReturn
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEAN_UP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
SHUT_DOWN = Transition.TRANSITION_ACTIVE_SHUTDOWN
MANAGED = {'autostart': False}


def change(graph: Graph, node: ManagedNode, transition: int) -> bool:
    """Ask a node for a transition, as a manager does."""
    return bool(
        graph.call(
            ChangeState, f'{node.get_name()}/change_state', transition=Transition(id=transition)
        ).success
    )


def state(graph: Graph, node: ManagedNode) -> int:
    return int(graph.call(GetState, f'{node.get_name()}/get_state').current_state.id)


def topics(node: ManagedNode) -> set[str]:
    entities = [*node.publishers, *node.subscriptions]
    names = {entity.topic_name for entity in entities}
    return names | {service.srv_name for service in node.services} | {str(len(list(node.timers)))}


def test_a_manager_takes_every_node_through_its_life_twice(graph, node_type, needed):
    node = graph.start(node_type, {**MANAGED, **needed.get(node_type, {})})
    assert state(graph, node) == State.PRIMARY_STATE_UNCONFIGURED
    before = topics(node)
    for _ in range(2):
        assert change(graph, node, CONFIGURE)
        assert state(graph, node) == State.PRIMARY_STATE_INACTIVE
        assert topics(node) > before - {str(len(list(node.timers)))} - {'0', '1'}
        for _ in range(2):
            assert change(graph, node, ACTIVATE)
            assert state(graph, node) == State.PRIMARY_STATE_ACTIVE
            assert change(graph, node, DEACTIVATE)
        assert change(graph, node, CLEAN_UP)
        assert topics(node) == before
    assert change(graph, node, CONFIGURE)
    assert change(graph, node, ACTIVATE)
    assert change(graph, node, SHUT_DOWN)
    assert state(graph, node) == State.PRIMARY_STATE_FINALIZED
    name = node.get_name()
    assert name in graph.user.get_node_names()
    graph.stop(node)
    graph.until(lambda: name not in graph.user.get_node_names(), f'{name} to leave the graph')


def test_the_manager_of_navigation2_starts_pauses_and_ends_the_suite(graph, tmp_path):
    """With `bond_timeout: 0.0`: its lifecycle_manager's calls, in its order, and its checks."""
    kinds = (BagRecorder, SolitonAnalyser, SolitonSteering, EdgeActuator, Simulator)
    of_its_own = {
        BagRecorder: {'output': str(tmp_path / 'run')},
        Simulator: {'chain.number_of_rotors': 8, 'publish_rate': 100.0},
    }
    nodes = [graph.start(kind, {**MANAGED, **of_its_own.get(kind, {})}) for kind in kinds]
    heard = graph.hear(interfaces.SOLITON_STATE)

    def all_to(transition: int, expected: int, backwards: bool = False) -> None:
        for node in reversed(nodes) if backwards else nodes:
            assert change(graph, node, transition)
            assert state(graph, node) == expected

    all_to(CONFIGURE, State.PRIMARY_STATE_INACTIVE)
    for _ in range(2):
        heard.clear()
        all_to(ACTIVATE, State.PRIMARY_STATE_ACTIVE)
        graph.until(lambda: heard, 'states')
        all_to(DEACTIVATE, State.PRIMARY_STATE_INACTIVE, backwards=True)
    all_to(CLEAN_UP, State.PRIMARY_STATE_UNCONFIGURED, backwards=True)
    end = Transition.TRANSITION_UNCONFIGURED_SHUTDOWN
    all_to(end, State.PRIMARY_STATE_FINALIZED, backwards=True)


def test_an_invalid_transition_is_rejected_and_the_node_continues(graph, said):
    node = graph.start(SolitonAnalyser)
    assert state(graph, node) == State.PRIMARY_STATE_ACTIVE
    assert not change(graph, node, CONFIGURE)
    assert not change(graph, node, 250)
    assert state(graph, node) == State.PRIMARY_STATE_ACTIVE
    assert f'rejected transition {CONFIGURE}, which state active' in said()


class Fragile(ManagedNode):
    """Node that fails in a chosen transition."""

    FAILING: ClassVar[set[str]] = set()

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('fragile', **kwargs)

    def configure(self) -> None:
        self.create_publisher(Float64, 'made', 1)
        self.fail('configure')

    def activate(self) -> None:
        self.fail('activate')

    def deactivate(self) -> None:
        self.fail('deactivate')

    def cleanup(self) -> None:
        self.fail('cleanup')

    def fail(self, where: str) -> None:
        if where in self.FAILING:
            raise ValueError(f'{where} fails; fix it')


def test_a_failed_configuration_logs_the_reason_and_can_be_repeated(graph, monkeypatch, said):
    node = graph.start(Fragile, MANAGED)
    before = topics(node)
    monkeypatch.setattr(Fragile, 'FAILING', {'configure', 'activate'})
    assert not change(graph, node, CONFIGURE)
    assert state(graph, node) == State.PRIMARY_STATE_UNCONFIGURED
    assert topics(node) == before
    assert 'configure fails; fix it' in said()
    Fragile.FAILING.remove('configure')
    assert change(graph, node, CONFIGURE)
    assert not change(graph, node, ACTIVATE)
    assert state(graph, node) == State.PRIMARY_STATE_INACTIVE
    Fragile.FAILING.clear()
    assert change(graph, node, ACTIVATE)


def test_nothing_keeps_a_node_from_stopping(graph, monkeypatch, said):
    monkeypatch.setattr(Fragile, 'FAILING', {'deactivate', 'cleanup'})
    node = graph.start(Fragile)
    assert change(graph, node, DEACTIVATE)
    assert change(graph, node, CLEAN_UP)
    assert state(graph, node) == State.PRIMARY_STATE_UNCONFIGURED
    assert 'cleanup fails; fix it' in said()
    Fragile.FAILING.clear()


def test_a_node_that_starts_by_itself_raises_its_error(graph, monkeypatch):
    monkeypatch.setattr(Fragile, 'FAILING', {'activate'})
    with pytest.raises(ValueError, match='activate fails; fix it'):
        graph.start(Fragile)


def test_a_deactivated_simulator_stops_and_continues_with_the_next_frame(graph):
    heard = graph.hear(interfaces.JOINT_STATES)
    simulator = graph.start(Simulator, {'chain.number_of_rotors': 8, 'publish_rate': 100.0})
    graph.until(lambda: len(heard) > 3, 'frames')
    assert change(graph, simulator, DEACTIVATE)
    last = simulator.control.status.frames
    graph.until(lambda: len(heard) == last, 'all frames')
    kicks = graph.user.create_publisher(
        interfaces.ROTOR_IMPULSES.type, interfaces.ROTOR_IMPULSES.name, 1
    )
    graph.until(kicks.get_subscription_count, 'the simulator')
    kicks.publish(interfaces.ROTOR_IMPULSES.type())
    graph.until(lambda: simulator.diagnostics.rejected, 'a refusal')
    assert simulator.control.status.frames == last
    assert change(graph, simulator, ACTIVATE)
    graph.until(lambda: len(heard) > last + 3, 'more frames')
    stamps = [10**9 * m.header.stamp.sec + m.header.stamp.nanosec for m in heard]
    assert set(np.diff(stamps)) == {10**7}


def test_a_deactivated_actuator_releases_the_chain(graph):
    torques = graph.hear(interfaces.ROTOR_TORQUES)
    graph.start(Simulator, {'chain.number_of_rotors': 8, 'publish_rate': 100.0})
    actuator = graph.start(
        EdgeActuator, {'nudge_as': 'pressure', 'nudge_duration': 60.0, 'state_timeout': 60.0}
    )
    nudge = graph.speak(interfaces.NUDGE)
    graph.until(lambda: actuator.frames.taken and actuator.commands.chain, 'the chain')
    nudge.publish(Float64(data=1.0))
    graph.until(lambda: torques and any(torques[-1].effort), 'torques')
    assert change(graph, actuator, DEACTIVATE)
    graph.until(lambda: not any(torques[-1].effort), 'no torque')
    nudge.publish(Float64(data=1.0))
    graph.until(lambda: actuator.diagnostics.rejected, 'a refusal')
    assert change(graph, actuator, ACTIVATE)
    nudge.publish(Float64(data=1.0))
    graph.until(lambda: any(torques[-1].effort), 'torques again')


def test_a_deactivated_recorder_records_nothing_and_continues_its_bag(graph, tmp_path):
    recorder = graph.start(BagRecorder, {**MANAGED, 'output': str(tmp_path / 'run')})
    assert change(graph, recorder, CONFIGURE)
    nudge = graph.speak(interfaces.NUDGE)
    nudge.publish(Float64(data=1.0))
    assert change(graph, recorder, ACTIVATE)
    before = recorder.messages
    nudge.publish(Float64(data=2.0))
    graph.until(lambda: recorder.messages > before, 'a message')
    assert change(graph, recorder, DEACTIVATE)
    assert (tmp_path / 'run_0/run_0_0.mcap').stat().st_size
    assert change(graph, recorder, CLEAN_UP)
    assert (tmp_path / 'run_0/metadata.yaml').exists()


def test_the_shutdown_of_a_node_that_has_done_nothing(graph):
    node = graph.start(Fragile, MANAGED)
    assert node.trigger_shutdown() == TransitionCallbackReturn.SUCCESS


def test_transitions_while_frames_pour_in(graph):
    heard = graph.hear(interfaces.SOLITON_STATE)
    graph.start(Simulator, {'chain.number_of_rotors': 8, 'publish_rate': 500.0})
    analyser = graph.start(SolitonAnalyser)
    for _ in range(5):
        graph.until(lambda: heard, 'states')
        assert change(graph, analyser, DEACTIVATE)
        assert change(graph, analyser, CLEAN_UP)
        heard.clear()
        assert change(graph, analyser, CONFIGURE)
        assert change(graph, analyser, ACTIVATE)
