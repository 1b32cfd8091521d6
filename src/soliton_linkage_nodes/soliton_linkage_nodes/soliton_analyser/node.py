# SPDX-License-Identifier: Apache-2.0
"""The soliton analyser: where the chain is on its cycle, and what each frame shows of it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    ChainSource,
    OptionalChainSourceParameters,
)
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.frame_reader import EncoderMonitor
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.messages.state_conversions import events_to_msgs, state_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import ClockMonitor, nanoseconds_of
from soliton_linkage_nodes.runtime.subscriptions import (
    LONGEST_LAG,
    CountedSubscription,
    StreamSubscription,
)
from soliton_linkage_nodes.soliton_analyser.report import describe, figures


@dataclass(frozen=True)
class AnalyserParameters:
    """Parameters of the analyser."""

    noise: float = quantity(
        0.0, "standard deviation of the encoders' noise, 0 to have it estimated", 'rad', 0.0, 1.0
    )
    longest_lag: float = quantity(
        LONGEST_LAG,
        'how long the analysis may be behind the frames before it skips those that wait, 0 for '
        'ever, as where a bag is played faster than it is analysed, and states then wait for '
        'subscribers that are busy; half of it skips more and is current sooner, twice skips '
        'less and is current later',
        's',
        0.0,
        60.0,
    )
    misfit_limit: float = quantity(
        0.1,
        "root mean square by which angles may miss the chain's configurations before that is a "
        'warning; half of it warns of weaker phonons too, twice of grossly wrong chains alone',
        'rad',
        1e-3,
        10.0,
    )


class SolitonAnalyser(ManagedNode):
    """Publishes what each frame of joint states shows, and where the chain is on its cycle.

    Subscribes to `joint_states` [rad, rad/s], to `joint_state_deviations` [rad], by which they
    count, to `delivered_impulses` [N m s], which change the rate of a wall, and, unless told the
    chain by parameters, to `chain`. Publishes `soliton_state`, what happens to walls on
    `soliton_events`, and `/diagnostics`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        AnalyserParameters: '',
        ManagedParameters: '',
        OptionalChainSourceParameters: '',
        **CHAIN_PARAMETERS,
    }

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('soliton_analyser', **kwargs)

    def configure(self) -> None:
        """Learn the chain and its orbit, and listen to its joints."""
        self.waiting: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._decoder = JointStateDecoder()
        self._stamps = ClockMonitor()
        self._frames = 0
        self._busy = 0.0
        self._reported = (time.monotonic(), 0, 0.0)
        self.diagnostics = Diagnostics(self, 'analysis', self.reporting(self._report))
        settings = self.settings = current(self, AnalyserParameters)
        self._whole = interfaces.lossless_stream_qos()
        self._analysis = JointStateAnalysis(settings.noise or None)
        frames, states = interfaces.JOINT_STATES, interfaces.SOLITON_STATE
        if not settings.longest_lag:
            frames, states = (replace(each, qos=self._whole) for each in (frames, states))
        self._publisher = states.publisher(self)
        self._events = interfaces.SOLITON_EVENTS.publisher(self)
        self._source = ChainSource(
            self, self.diagnostics, self._on_chain, OptionalChainSourceParameters
        )
        self._encoders = EncoderMonitor(self.get_logger().warning)
        topic = interfaces.DELIVERED_IMPULSES
        self._push = self.diagnostics.guarded(topic.name, self._analysis.add_impulses)
        push = self.while_active(partial(self._act_or_wait, self._push))
        self._impulses = CountedSubscription(self, topic, push, self.diagnostics, raw=True)
        topic = interfaces.JOINT_STATE_DEVIATIONS
        self._deviation_decoder = JointStateDecoder()
        self._weigh = self.diagnostics.guarded(topic.name, self._weigh_decoded)
        weigh = self.while_active(partial(self._act_or_wait, self._weigh))
        self._deviations = CountedSubscription(self, topic, weigh, self.diagnostics, raw=True)
        take = self.while_active(self.take)
        StreamSubscription(
            self,
            frames,
            take,
            self.diagnostics,
            raw=True,
            longest_lag=settings.longest_lag,
            on_takeover=self._source.resubscribe,
        )
        name = self.resolve_topic_name(frames.name)
        self.get_logger().info(f'analysing {name} of {self._source.description}')

    def deactivate(self) -> None:
        """Forget what waits for a chain."""
        self.waiting.clear()

    def _on_chain(self, named: NamedChain) -> None:
        """Take what came before the chain was known."""
        self._analysis.set_chain(named)
        while self.waiting:
            act, serialized = self.waiting.popleft()
            act(serialized)

    def take(self, serialized: bytes) -> None:
        """Analyse joint states and publish what they show, once the chain is known."""
        # Topics wait in no order of each other: what acts at a frame must be known before it.
        self._impulses.take_waiting()
        self._deviations.take_waiting()
        self._act_or_wait(self._analyse, serialized)

    def _act_or_wait(self, act: Callable[[bytes], None], serialized: bytes) -> None:
        """Act on a message once the chain is known, in the order in which messages came."""
        chain_may_come = self._source.parameters.chain_from != 'nowhere'
        if self._analysis.analyser is None and chain_may_come:
            self.waiting.append((act, serialized))
            size = len(serialized)
            deep = interfaces.stream_qos(size) if self.settings.longest_lag else self._whole
            if len(self.waiting) > deep.depth:
                self.waiting.popleft()
        else:
            act(serialized)

    def _weigh_decoded(self, serialized: bytes) -> None:
        self._analysis.add_deviations(self._deviation_decoder.decode(serialized))

    def _analyse(self, serialized: bytes) -> None:
        begin = time.perf_counter()
        try:
            joints = self._decoder.decode(serialized)
            stamp = joints.stamp
            self._stamps.note(stamp, nanoseconds_of(self.get_clock()))
            if self._analysis.analyser is None:
                self._analysis.set_joints(self._source.parameters.joint_names or joints.name)
            analysis = self._analysis.analyse(joints)
            if self._analysis.frame is not None:
                self._encoders.check(stamp, self._analysis.frame.angles)
        except ValueError as error:
            self.diagnostics.reject('joint_states', error)
            return
        if analysis is not None:
            if self._publisher.get_subscription_count():
                self._publisher.publish(state_to_msg(analysis, joints))
            for event in events_to_msgs(analysis, joints, self._analysis.spacing):
                self._events.publish(event)
            self._frames += 1
        self._busy += time.perf_counter() - begin

    def _report(self) -> Report:
        now = time.monotonic()
        before, frames_before, busy_before = self._reported
        self._reported = (now, self._frames, self._busy)
        fresh = self._frames - frames_before
        values: dict[str, Any] = {
            'rate [Hz]': fresh / (now - before),
            'time per frame [ms]': 1e3 * (self._busy - busy_before) / max(fresh, 1),
            'frames': self._frames,
            'subscribers': self._publisher.get_subscription_count(),
            **self._stamps.figures(),
        }
        message, warning = describe(self._analysis, self.settings.misfit_limit)
        if not fresh:
            message, warning = self._waits_for(), True
        return Report(message, {**values, **figures(self._analysis)}, warning)

    def _waits_for(self) -> str:
        if self._analysis.analyser is None and self._source.parameters.chain_from == 'topic':
            return (
                'waiting for the topic chain; where there is none, set chain_from to parameters '
                'or to nowhere'
            )
        return 'waiting for joint_states'


def main() -> None:
    """Run the analyser until it is told to stop."""
    run(SolitonAnalyser)
