# SPDX-License-Identifier: Apache-2.0
"""Simulator node, which replaces a real chain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from soliton_linkage.dynamics.world import World, WorldParameters, joint_numbers
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.encoders import EncoderErrors
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import described_fields, quantity
from soliton_linkage.solitons.passage import Obstacle, find_obstacles
from soliton_linkage_nodes.messages.cdr import ImpulseDecoder, TorqueDecoder
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    declare_chain,
    describe_chain,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.pacing import PacedLoop
from soliton_linkage_nodes.runtime.parameters import make_adjustable
from soliton_linkage_nodes.runtime.stamps import SECOND, stamp_of
from soliton_linkage_nodes.runtime.subscriptions import CountedSubscription
from soliton_linkage_nodes.simulator.control import SimulationControl, SimulationStatus
from soliton_linkage_nodes.simulator.frame_publisher import FramePublisher, SensedJoints
from soliton_linkage_nodes.simulator.services import SimulationServices, serve_standard

_SLOWEST = 1e-6
"""Smallest real-time factor above 0 [1]. At a frame rate of 300 Hz, it means one frame per
hour."""
_NON_RECIPROCITY = 'chain.non_reciprocity'
_POLL_INTERVAL = 0.02
"""Poll interval while waiting for subscribers [s]."""


@dataclass(frozen=True)
class SimulatorParameters(WorldParameters):
    """Parameters of the simulator itself, without the chain, the gravity and the sensors."""

    publish_rate: float = quantity(
        500.0, 'rate of joint_states in simulated time', 'Hz', 1.0, 10_000.0
    )
    real_time_factor: float = quantity(
        1.0, 'simulated time per real time, 0 for no limit', '', 0.0, 1000.0, adjustable=True
    )
    missing_joints: tuple[str, ...] = quantity(
        (), 'joints left out of joint_states, by name or number; empty for none'
    )
    command_timeout: float = quantity(
        0.5, 'time without a new message after which torques end, 0 for never', 's', 0.0, 86_400.0
    )
    stamp_tolerance: float = quantity(
        10.0,
        'impulses and torques are rejected if their stamp differs by more than this both from the '
        'clock and from the stamp of the last frame, 0 for no limit. Sensitivity: at 0.5x, '
        'messages may be half as old',
        's',
        0.0,
        86_400.0,
    )
    impulse_limit: float = quantity(0.1, 'largest angular impulse accepted', 'N m s', 0.0, 1e6)
    torque_limit: float = quantity(10.0, 'largest torque accepted', 'N m', 0.0, 1e6)
    energy_drift_limit: float = quantity(
        1e-3,
        'relative energy drift of the solver above which the node warns. Sensitivity: at 0.5x it '
        'warns earlier; at 2x later',
        '',
        0.0,
        1.0,
    )
    publish_clock: bool = quantity(False, 'whether to publish the simulated time on /clock')
    subscribers: int = quantity(
        0, 'number of subscribers of joint_states to wait for before the first frame', '', 0, 1000
    )


class Simulator(ManagedNode):
    """Node that publishes the angles of a simulated chain at a fixed rate.

    It publishes `joint_states` [rad, rad/s, N m], `chain` (latched), `delivery` (latched) and
    `/diagnostics`. If `publish_clock` is true, it also publishes `/clock`. Before each frame at
    which impulses act, it publishes the sum of these impulses on `delivered_impulses` [N m s].

    It subscribes to `rotor_impulses` [N m s], `rotor_torques` [N m] and `tilt` [rad]. A message on
    `tilt` sets the parameter `gravity.tilt`. It serves `~/pause`, `~/step` and `~/reset`. If the
    package simulation_interfaces is installed, it also serves the services of this package. A
    changed parameter takes effect at the next frame.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        SimulatorParameters: '',
        ManagedParameters: '',
        Gravity: 'gravity.',
        EncoderErrors: 'sensors.',
        **CHAIN_PARAMETERS,
    }

    def configure(self) -> None:
        """Create the chain, the simulation, the topics and the services."""
        settings = self.settings = self.current(SimulatorParameters)
        self.named = declare_chain(self)
        make_adjustable(self, _NON_RECIPROCITY)
        chain, names = self.named.chain, self.named.joint_names
        gravity = self.current(Gravity)
        errors = self.current(EncoderErrors)
        self._impulses = ImpulseDecoder(self.named.numbers, settings.impulse_limit)
        self._torques = TorqueDecoder(self.named.numbers, settings.torque_limit)
        period = 1 / settings.publish_rate
        missing = joint_numbers('missing_joints', settings.missing_joints, names)
        self._joints = SensedJoints(self.named, period, errors, missing)
        world = World(chain, names, settings, period)
        self.frames = FramePublisher(
            self, self.named, self._joints, settings.publish_rate, settings.publish_clock
        )
        calls, timeout = (self.frames.publish, self.frames.announce), settings.command_timeout
        state = world.initial_state()
        self.control = SimulationControl(world.begin, state, gravity, timeout, *calls)
        pace = self._pace(settings.real_time_factor)
        self.loop = PacedLoop(pace, self.control.tick, self.real_time)
        complain = self.get_logger().error
        self._figures = SimulationReport(self.control, self.loop, settings, complain)
        self.diagnostics = Diagnostics(self, 'simulation', self.reporting(self._report))
        self._obstacles = find_obstacles(chain)
        self._subscribe()
        most = self.frames.depth
        services = SimulationServices(self, self.named, world, self.control, period, most)
        serve_standard(self, services)
        self.get_logger().info(describe_simulation(chain, settings))
        if self._obstacles:
            self.get_logger().warning(describe_obstacles(self._obstacles))
        self._start_timer = self.create_timer(_POLL_INTERVAL, self._begin)
        self._start_timer.cancel()

    def activate(self) -> None:
        """Wait for enough subscribers, then publish the chain and start or resume the frames."""
        self.control.resume()
        self._start_timer.reset()
        self._begin()

    def deactivate(self) -> None:
        """Stop the simulation loop and set all torques to 0."""
        self._start_timer.cancel()
        self.control.stop()
        self.loop.stop()
        self.control.hold(np.zeros(self.named.rotors))
        self.frames.flush()

    @property
    def frame_rate(self) -> float:
        """Frames per second of real time [Hz], as the real-time factor specifies.

        The value is infinite if the factor is 0, which means as fast as possible.
        """
        return self.loop.rate if self.configured else math.inf

    @property
    def failure(self) -> Exception | None:
        """Error that has ended the simulation loop, or None."""
        return self.loop.failure if self.configured else None

    def _begin(self) -> None:
        if self.frames.subscribers >= self.settings.subscribers:
            self._start_timer.cancel()
            self.frames.begin()
            self.loop.start()

    def _subscribe(self) -> None:
        guarded = self.diagnostics.guarded
        for topic, callback in (
            (interfaces.ROTOR_IMPULSES, self._on_impulses),
            (interfaces.ROTOR_TORQUES, self._on_torques),
        ):
            take = guarded(topic.name, callback)
            CountedSubscription(self, topic, take, self.diagnostics, raw=True)
        interfaces.TILT.subscribe(self, guarded('tilt', self._on_tilt))

    def _on_impulses(self, serialized: bytes) -> None:
        self.check_active()
        impulses = self._impulses.decode(serialized)
        self._check_stamp(stamp_of(serialized))
        complaint = self.control.kick(impulses) if impulses.any() else None
        if complaint:
            raise ValueError(complaint)

    def _on_torques(self, serialized: bytes) -> None:
        self.check_active()
        torques = self._torques.decode(serialized)
        self._check_stamp(stamp_of(serialized))
        self.control.hold(torques)

    def _check_stamp(self, stamp: int) -> None:
        """Check the stamp of impulses or torques [ns]; 0 is always accepted.

        Raises ValueError if the stamp differs by more than `stamp_tolerance` from both the clock
        and the stamp of the last frame.
        """
        limit = self.settings.stamp_tolerance
        if not (stamp and limit):
            return
        clock, frames = self.get_clock().now().nanoseconds, self.frames.stamp
        apart = min(abs(clock - stamp), abs(frames - stamp)) / SECOND
        if apart > limit:
            raise ValueError(
                f'the stamp is {apart:.3g} s in the {"future" if stamp > clock else "past"}, the '
                f'limit is {limit:g} s; use the current time or 0, or raise stamp_tolerance'
            )

    def _on_tilt(self, message: Float64) -> None:
        complaint = described_fields(Gravity)['tilt'].complaint(message.data)
        if complaint:
            raise ValueError(f'gravity.tilt = {message.data} {complaint}')
        (result,) = self.set_parameters([Parameter('gravity.tilt', value=message.data)])
        if not result.successful:
            raise ValueError(result.reason)
        if not self.get_parameter('gravity.acceleration').value:
            self.get_logger().warning(
                'tilt has no effect without gravity; set gravity.acceleration', once=True
            )

    def follow_parameters(self) -> None:
        """Apply changed parameters of gravity, motors and encoders, and the real-time factor."""
        motors = self.get_parameter(_NON_RECIPROCITY).value
        if motors != self.named.chain.non_reciprocity:
            chain = replace(self.named.chain, non_reciprocity=motors)
            self.named = replace(self.named, chain=chain)
            self.control.set_non_reciprocity(motors)
            self.frames.publish_chain(self.named)
        self.control.set_gravity(self.current(Gravity))
        self._joints.change(self.current(EncoderErrors))
        self.loop.rate = self._pace(self.get_parameter('real_time_factor').value)

    def _pace(self, real_time_factor: float) -> float:
        """Return the frames per second of real time [Hz]; infinite for the factor 0 (no limit)."""
        if real_time_factor == 0:
            return math.inf
        return max(real_time_factor, _SLOWEST) * self.settings.publish_rate

    def _report(self) -> Report:
        if not self._start_timer.is_canceled():
            present, required = self.frames.subscribers, self.settings.subscribers
            line = f'waiting for {required} subscribers of joint_states, there are {present}'
            return Report(line, warning=True)
        gravity = self.current(Gravity)
        world = {
            'motion': self.named.chain.motion.value,
            'bonds that may stop a soliton': len(self._obstacles),
            'gravity [m/s^2]': gravity.acceleration,
            'tilt [rad]': gravity.tilt,
        }
        return self._figures(world)


_FRAMES_OVERDUE = 3
"""The report warns if no frame was published since the last report although more than this number
of frames were due [1]. At low frame rates, up to 3 due frames may be missing without a fault: one
at each end of the interval, and a late one."""


class SimulationReport:
    """Report of a simulation. Rates are averages over the time since the previous report."""

    def __init__(
        self,
        control: SimulationControl,
        loop: PacedLoop,
        settings: SimulatorParameters,
        complain: Callable[[str], object],
    ) -> None:
        """Create the report, which passes each new fault of the simulation to `complain`."""
        self._control = control
        self._loop = loop
        self._settings = settings
        self._complain = complain
        self._logged = ''
        self._increments = Increments()

    def __call__(self, world: Mapping[str, Any]) -> Report:
        """Return the current report. `world` contains further named values for the report."""
        status, punctuality = self._control.status, self._loop.punctuality
        seconds, frames, late = self._increments.take(status.frames, punctuality.missed)
        rate = frames / seconds
        late = 0 if status.paused else late
        overdue = seconds * min(self._loop.rate, self._settings.publish_rate) > _FRAMES_OVERDUE
        slow = not status.paused and not rate and overdue
        message, fault = self._message(status, late, slow)
        if fault and fault != self._logged:
            self._complain(fault)
        self._logged = fault
        figures = {
            'publish rate [Hz]': rate,
            'real-time factor': rate / self._settings.publish_rate,
            'frames': status.frames,
            'missed deadlines': punctuality.missed,
            'largest lateness [s]': punctuality.largest_lateness,
            'lag [s]': punctuality.lag,
            'energy [J]': status.energy,
            'dissipated [J]': status.dissipated,
            'energy drift': status.energy_drift,
        }
        return Report(message, {**figures, **world}, warning=bool(fault or late))

    def _message(self, status: SimulationStatus, late: int, slow: bool) -> tuple[str, str]:
        """Return the message of the report, and the fault to log, or '' without a fault."""
        if status.failure:
            return (f'paused, {status.failure}',) * 2
        if slow:
            steps = self._control.simulation.steps_per_frame
            message = (
                f'the next frame takes long to compute, {steps:.1g} steps of the solver at least; '
                'use softer springs, heavier masses, less damping or slower rotors'
            )
            return message, message
        fault = ''
        if abs(status.energy_drift) > self._settings.energy_drift_limit:
            fault = (
                f'the energy drift of the solver exceeds energy_drift_limit = '
                f'{self._settings.energy_drift_limit:g}; use a smaller tolerance'
            )
        if status.paused:
            return 'paused', fault
        if late:
            return f'{late} deadlines missed in the last second', fault
        return fault or 'on time', fault


def describe_simulation(chain: Chain, settings: SimulatorParameters) -> str:
    """Return a text for the log about the chain, the mechanics and the frame rate."""
    elastic = settings.mechanics == 'elastic'
    how = f'elastic, integrator {settings.integrator}' if elastic else settings.mechanics
    return f'simulating {describe_chain(chain)}, {how}, at {settings.publish_rate:g} Hz'


def describe_obstacles(obstacles: Sequence[Obstacle]) -> str:
    """Return a warning about bonds that may stop a soliton."""
    first = obstacles[0]
    return (
        f'{len(obstacles)} bonds may stop a soliton, first bond {first.bond} between rotors '
        f'{first.bond} and {first.bond + 1}: its spring of {first.rest_length:.6g} m '
        f'{first.reason}; lower the deviations of the chain'
    )
