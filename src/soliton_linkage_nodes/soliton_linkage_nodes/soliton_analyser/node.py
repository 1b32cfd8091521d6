# SPDX-License-Identifier: Apache-2.0
"""Soliton analyser, which estimates the state of the chain in each frame."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis, FrameAnalyser
from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.messages.cdr import JointStateDecoder, stamped
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    ChainSource,
    OptionalChainSourceParameters,
)
from soliton_linkage_nodes.messages.conversions import JointStates, NamedChain
from soliton_linkage_nodes.messages.frames import EncoderMonitor, SerializedFrames
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.messages.state_conversions import events_to_msgs, state_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.interfaces import Topic
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.stamps import ClockMonitor, nanoseconds_of
from soliton_linkage_nodes.runtime.subscriptions import (
    LONGEST_LAG,
    CountedSubscription,
    StreamSubscription,
)

_LONGEST_ASSEMBLY = 1.0
"""Period of the timer that ends the wait for the missing joints of a frame [s]. The timer analyses
a frame that was already incomplete at the previous call. A wait therefore lasts one to two
periods, but ends earlier if another frame begins."""
_FRAMES_BEFORE_REPORT = 100
"""Number of analysed frames after which the node warns of joints that had no angle so far [1]."""


@dataclass(frozen=True)
class AnalyserParameters:
    """Parameters of the analyser."""

    noise: float = quantity(
        0.0, "standard deviation of the encoders' noise, 0 to estimate it", 'rad', 0.0, 1.0
    )
    longest_lag: float = quantity(
        LONGEST_LAG,
        'longest time that the analysis may lag behind the frames before it skips waiting frames; '
        '0: never skip, and keep states for slow subscribers, for example while a bag is played '
        'faster than it is analysed. Sensitivity: at 0.5x it skips more frames and catches up '
        'earlier; at 2x it skips fewer and catches up later',
        's',
        0.0,
        60.0,
    )
    misfit_limit: float = quantity(
        0.1,
        "root mean square distance of the angles from the chain's configurations above which the "
        'node warns. Sensitivity: at 0.5x it also warns of weaker phonons; at 2x only of grossly '
        'wrong chains',
        'rad',
        1e-3,
        10.0,
    )
    stamps: str = quantity(
        'header',
        'time of a frame: its stamp (header), or its arrival, for drivers that publish no stamps',
        choices=('header', 'arrival'),
    )


class SolitonAnalyser(ManagedNode):
    """Node that estimates the solitons (walls) of the chain and other quantities for each frame.

    The other quantities are topological quantities such as the total charge (see the message
    Topology), energies (see the message Energies) and the orbit phase. The orbit phase is the
    phase of the periodic motion in which a soliton travels from edge to edge and is reflected
    there.

    It subscribes to `joint_states` [rad, rad/s] and, unless parameters specify the chain, to
    `chain`. It also subscribes to `joint_state_deviations` [rad], the standard deviations of the
    angles, and to `delivered_impulses` [N m s], which change the velocity of a soliton. It
    publishes `soliton_state`, `soliton_events` and `/diagnostics`. Events are births, reflections
    and collisions of solitons.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        AnalyserParameters: '',
        ManagedParameters: '',
        OptionalChainSourceParameters: '',
        **CHAIN_PARAMETERS,
    }

    def configure(self) -> None:
        """Read the parameters, and create the publishers and the subscriptions."""
        self.waiting: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._decoder = JointStateDecoder()
        self._stamps = ClockMonitor()
        self._frames = 0
        self._reported_absent = False
        self._busy = 0.0
        self._increments = Increments()
        self.diagnostics = Diagnostics(self, 'analysis', self.reporting(self._report))
        settings = self.settings = self.current(AnalyserParameters)
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
        self._deviation_decoder = JointStateDecoder()
        self._supplements = [
            self._subscribe(interfaces.DELIVERED_IMPULSES, self._analysis.add_impulses),
            self._subscribe(interfaces.JOINT_STATE_DEVIATIONS, self._add_deviations),
        ]
        take = self.while_active(self.take)
        self._frames_of = StreamSubscription(
            self,
            frames,
            take,
            self.diagnostics,
            raw=True,
            longest_lag=settings.longest_lag,
            on_takeover=self._source.resubscribe,
            parts=SerializedFrames().parts,
        )
        self._waiting_since: int | None = None
        self.create_timer(_LONGEST_ASSEMBLY, self._end_assembly)
        name = self.resolve_topic_name(frames.name)
        self.get_logger().info(f'analysing {name} of {self._source.description}')

    def _subscribe(self, topic: Topic, act: Callable[[bytes], None]) -> CountedSubscription:
        guarded = self.diagnostics.guarded(topic.name, act)
        take = self.while_active(partial(self._act_or_wait, guarded))
        return CountedSubscription(self, topic, take, self.diagnostics, raw=True)

    def deactivate(self) -> None:
        """Drop the messages that wait until the chain is known."""
        self.waiting.clear()

    def _on_chain(self, named: NamedChain) -> None:
        self._analysis.set_chain(named)
        while self.waiting:
            act, serialized = self.waiting.popleft()
            act(serialized)

    def take(self, serialized: bytes) -> None:
        """Analyse joint states and publish the result; store them if the chain is unknown."""
        # Impulses and standard deviations must be processed before the frame to which they belong,
        # but messages of different topics arrive in any order.
        if self.settings.stamps == 'arrival':
            serialized = stamped(serialized, self._frames_of.received_at)
        for supplement in self._supplements:
            supplement.take_waiting()
        self._act_or_wait(self._analyse, serialized)

    def _act_or_wait(self, act: Callable[[bytes], None], serialized: bytes) -> None:
        """Call `act` with a message; store the message if the chain is still unknown."""
        chain_may_come = self._source.parameters.chain_from != 'nowhere'
        if self._analysis.analyser is None and chain_may_come:
            self.waiting.append((act, serialized))
            size = len(serialized)
            deep = interfaces.stream_qos(size) if self.settings.longest_lag else self._whole
            if len(self.waiting) > deep.depth:
                self.waiting.popleft()
        else:
            act(serialized)

    def _add_deviations(self, serialized: bytes) -> None:
        self._analysis.add_deviations(self._deviation_decoder.decode(serialized))

    def _analyse(self, serialized: bytes) -> None:
        begin = time.perf_counter()
        try:
            joints = self._decoder.decode(serialized)
            self._stamps.note(joints.stamp, nanoseconds_of(self.get_clock()))
            if self._analysis.analyser is None:
                self._analysis.set_joints(self._source.parameters.joint_names or joints.name)
            for frame in self._analysis.assembler.add(joints):
                self._publish(frame)
        except ValueError as error:
            self.diagnostics.reject('joint_states', error)
            return
        self._busy += time.perf_counter() - begin

    def _publish(self, joints: JointStates) -> None:
        analysis = self._analysis.analyse(joints)
        if self._analysis.frame is not None:
            self._encoders.check(joints.stamp, self._analysis.frame.angles)
        if analysis is None:
            return
        if self._publisher.get_subscription_count():
            self._publisher.publish(state_to_msg(analysis, joints))
        for event in events_to_msgs(analysis, joints, self._analysis.spacing):
            self._events.publish(event)
        self._frames += 1

    def _end_assembly(self) -> None:
        """Analyse a frame that has been incomplete for too long; warn of joints without angles."""
        if not self.active:
            return
        assembler, before = self._analysis.assembler, self._waiting_since
        self._waiting_since = assembler.waiting_since
        if before is not None and before == self._waiting_since:
            try:
                for frame in assembler.flush():
                    self._publish(frame)
            except ValueError as error:
                self.diagnostics.reject('joint_states', error)
        absent = self._analysis.absent
        if absent and self._frames > _FRAMES_BEFORE_REPORT and not self._reported_absent:
            self._reported_absent = True
            self.get_logger().warning(
                f'joint_states had no angle of {len(absent)} of '
                f'{len(self._analysis.joint_names)} joints so far, first {absent[0]!r}; '
                'their rotors are estimated from the others. Check the names and the publishers'
            )

    def _report(self) -> Report:
        seconds, fresh, busy = self._increments.take(self._frames, self._busy)
        values: dict[str, Any] = {
            'rate [Hz]': fresh / seconds,
            'time per frame [ms]': 1e3 * busy / max(fresh, 1),
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
                'waiting for the topic chain; if no node publishes it, set chain_from to '
                'parameters or nowhere'
            )
        return 'waiting for joint_states'


_MISFIT_OVER_NOISE = 3.0
"""The node warns of a misfit only if the misfit exceeds this number times the noise of the angles
[1]. The misfit is the root mean square difference between the angles near the soliton and the
angles on the periodic orbit of the chain, over recent frames."""
_CONTRADICTION_CONFIDENCE = 0.999
"""The node warns if the angles show another motion class than the parameters specify, and if the
probability of the shown class exceeds this value [1]. The classes are flipper, wobbling flipper
and spinner."""


def describe(analysis: JointStateAnalysis, misfit_limit: float) -> tuple[str, bool]:
    """Return a text about the state of the analysis, and whether it is a warning.

    A warning reports, for example, a misfit that exceeds `misfit_limit` [rad] and that noise and
    phonons cannot explain.
    """
    analyser, latest = analysis.analyser, analysis.latest
    if analyser is None or latest is None:
        return 'no frame yet', False
    disagreement = _disagreement(latest)
    if disagreement:
        return disagreement, True
    if latest.unseen:
        return f'{latest.unseen} of {len(analysis.joint_names)} rotors are not visible', True
    alone = len(latest.solitons) < 2 and not analyser.limitation
    if alone and latest.estimate.status is TrackingStatus.LOST:
        return (
            'the angles do not fit one soliton of the chain; if the chain has one soliton, check '
            'the parameters in chain and that joint_states are in rad',
            True,
        )
    misfit = latest.estimate.misfit
    explained = max(misfit_limit, _MISFIT_OVER_NOISE * latest.estimate.noise, _swing(analysis))
    if misfit > explained:
        return (
            f'the misfit of the angles is {misfit:.3g} rad, above the misfit_limit of '
            f'{misfit_limit:g} rad; {_likely_error(analyser)}; identify_chain estimates it from a '
            'recording',
            True,
        )
    solitons = f'{len(latest.solitons)} solitons, {latest.status.value}'
    if analyser.limitation:
        return f'{solitons}; {analyser.limitation}', True
    return solitons, False


def _likely_error(analyser: FrameAnalyser) -> str:
    """Return a text about the most probable cause of a misfit.

    An error of the rest angle changes the angles far from the wall. Other errors change only the
    shape of the wall.
    """
    error = analyser.diagnostics.rest_angle_error
    if error:
        return f'the rotors far from the wall lean by {error:+.3g} rad more than chain.rest_angle'
    return 'the likeliest cause is an error of chain.rotor_length or chain.spacing'


def _disagreement(latest: Analysis) -> str:
    """Return a warning if the angles show another motion class than the parameters, else ''."""
    specified, measured = latest.motion, latest.measured_motion
    certain = measured.confidence > _CONTRADICTION_CONFIDENCE
    shown = measured.motion
    if specified is None or shown is None or shown is specified or not certain:
        return ''
    return (
        f'the angles show a {shown.value} (confidence {measured.confidence:.4f}), the '
        f'parameters specify a {specified.value}; check chain.rotor_length, chain.spacing and '
        'chain.rest_angle'
    )


def _swing(analysis: JointStateAnalysis) -> float:
    """Return w / omega_0, an upper limit of the rms angle of phonons [rad]; 0 if it is unknown.

    w is the rms angular velocity of all rotors in the latest frame [rad/s], and omega_0 is the
    lowest phonon frequency [rad/s]. A moving wall increases w, so that the limit remains valid.
    """
    frame, analyser = analysis.frame, analysis.analyser
    if frame is None or frame.rates is None or not isinstance(analyser, Analyser):
        return 0.0
    rates = frame.rates[np.isfinite(frame.rates)]
    slowest = gap(analyser.chain)
    if not (len(rates) and slowest):
        return 0.0
    return float(np.sqrt(np.mean(rates**2))) / slowest


def figures(analysis: JointStateAnalysis) -> dict[str, Any]:
    """Return named values of the analysis for `/diagnostics`."""
    analyser, latest = analysis.analyser, analysis.latest
    if analyser is None or latest is None:
        return {}
    found = analyser.diagnostics
    return {
        'late frames': found.late,
        'late impulses': found.late_impulses,
        'solitons': len(latest.solitons),
        'status': latest.status.value,
        'unseen rotors': latest.unseen,
        'noise [rad]': latest.estimate.noise,
        'misfit [rad]': latest.estimate.misfit,
        'starts': found.starts,
        'stamp error [s]': found.stamp_error,
        'motion of the angles': getattr(latest.measured_motion.motion, 'value', 'unknown'),
        'confidence': latest.measured_motion.confidence,
        'encoder offsets [rad]': ', '.join(
            f'{analysis.joint_names[rotor]} {found.offsets[rotor]:.4f} +- '
            f'{found.offset_deviations[rotor]:.4f}'
            for rotor in np.flatnonzero(found.offsets)
        ),
    }
