# SPDX-License-Identifier: Apache-2.0
"""The frames that a simulator publishes, beside the same chain simulated without it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from graphs import Graph
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_nodes.simulator.node import Simulator

ROTORS = 8
RATE = 300.0  # a period that is no whole number of nanoseconds
GIVEN = {'chain.number_of_rotors': ROTORS, 'publish_rate': RATE}
CHAIN = Chain(number_of_rotors=ROTORS)
NAMES = [f'rotor_{rotor}' for rotor in range(ROTORS)]
KICK = 10.0 * CHAIN.moment_of_inertia * edge_mode(CHAIN, CHAIN.uniform_state(-1), Edge.FIRST)
TORQUES = np.linspace(-1e-3, 2e-3, ROTORS)

Act = Callable[[ElasticSimulation], None]


def kick(simulation: ElasticSimulation) -> None:
    simulation.kick(KICK)


def hold(simulation: ElasticSimulation) -> None:
    simulation.hold(TORQUES)


def let_go(simulation: ElasticSimulation) -> None:
    simulation.hold(np.zeros(ROTORS))


def kick_message() -> RotorImpulses:
    return RotorImpulses(name=NAMES, impulse=list(KICK))


def torque_message() -> JointState:
    return JointState(name=NAMES, effort=list(TORQUES))


class Stream:
    """The frames that a simulator publishes, and the same chain simulated without it."""

    def __init__(self, graph: Graph, parameters: dict[str, Any] | None = None) -> None:
        self.graph = graph
        self.frames: list[JointState] = graph.hear(interfaces.JOINT_STATES)
        chains = graph.hear(interfaces.CHAIN)
        self._delivered = graph.hear(interfaces.DELIVERED_IMPULSES)
        self.node = graph.start(Simulator, {**GIVEN, **(parameters or {})})
        graph.until(lambda: chains and self.frames, 'the chain and a frame')
        self._impulses = graph.speak(interfaces.ROTOR_IMPULSES)
        self.rate = self.node.settings.publish_rate
        self.chain = chain_from_msg(chains[0]).chain
        self._epoch = time_from_msg(chains[0].header.stamp)

    def grow(self, frames: int) -> None:
        """Wait for a frame beyond those published now, which may still be in transit."""
        target = self.node.control.status.frames + frames
        self.graph.until(lambda: self.number(self.frames[-1]) >= target, f'{frames} frames')

    def kick(self) -> None:
        """Publish a kick and wait until the simulator has applied it."""
        kicks = len(self._delivered) + 1
        self._impulses.publish(kick_message())
        self.graph.until(lambda: len(self._delivered) == kicks, 'the kick')

    def wait_for_motion(self) -> None:
        """Wait until the rotors move faster than by rounding errors, which are 1e-14 rad/s."""
        self.graph.until(lambda: max(map(abs, self.frames[-1].velocity)) > 1e-6, 'the motion')

    def number(self, frame: JointState) -> int:
        """Return which frame it is; its stamp is exactly that many periods after the chain's."""
        since = time_from_msg(frame.header.stamp) - self._epoch
        number = round(since * self.rate / 1e9)
        assert since == round(number * 10**9 / self.rate)
        return number

    def pause(self, paused: bool = True) -> Any:
        return self.graph.call(SetBool, 'simulator/pause', data=paused)

    def reset(self, **request: Any) -> Any:
        return self.graph.call(Reset, 'simulator/reset', **request)

    def step(self, periods: int) -> Any:
        return self.graph.call(Step, 'simulator/step', periods=periods)

    def settled(self) -> int:
        """Return the number of frames once everything that was published has come."""
        last = self.node.control.status.frames
        self.graph.until(lambda: self.number(self.frames[-1]) == last - 1, 'the last frame')
        return len(self.frames)

    def explain(self, commands: Sequence[Act], lean: int = -1) -> list[int]:
        """Assert that the frames equal a simulation with these commands in this order.

        The numbers of the frames at which they took effect are returned. Of kicks the frame
        itself shows it, of torques the next one.
        """
        took_effect: list[int] = []
        while (unexplained := self._first_unlike(commands, took_effect, lean)) is not None:
            assert len(took_effect) < len(commands), f'frame {unexplained} is like no simulation'
            at = unexplained - (commands[len(took_effect)] is not kick)
            assert at not in took_effect
            took_effect.append(at)
        assert len(took_effect) == len(commands)
        return took_effect

    def _first_unlike(
        self, commands: Sequence[Act], took_effect: list[int], lean: int
    ) -> int | None:
        due = dict(zip(took_effect, commands, strict=False))
        twin = ElasticSimulation(
            self.chain,
            self.chain.uniform_state(lean),
            period=1 / self.rate,
            tolerance=self.node.settings.tolerance,
        )
        numbers = [self.number(frame) for frame in self.frames]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        for number in range(numbers[-1] + 1):
            if number in due:
                due[number](twin)
            if number >= numbers[0]:
                frame = self.frames[number - numbers[0]]
                torques = self.chain.spring_torques(twin.angles)
                seen = (frame.position, frame.velocity, frame.effort)
                if not all(map(np.array_equal, seen, (twin.angles, twin.rates, torques))):
                    return number
            twin.advance()
        return None


class Paused(Stream):
    """A simulator that is stepped on request."""

    def __init__(self, graph: Graph, parameters: dict[str, Any] | None = None) -> None:
        super().__init__(graph, parameters)
        assert self.pause().success

    def change(self, **changes: Any) -> Any:
        values = {name.replace('__', '.'): value for name, value in changes.items()}
        return self.graph.change('simulator', values)[0]

    def taken(self, periods: int) -> list[JointState]:
        """Return the frames of so many steps."""
        published = self.node.control.status.frames
        assert self.step(periods).success
        assert self.node.control.status.frames == published + periods
        self.settled()
        return self.frames[-periods:]
