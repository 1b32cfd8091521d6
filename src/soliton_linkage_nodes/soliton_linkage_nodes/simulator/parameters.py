# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulator."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.dynamics.world import WorldParameters
from soliton_linkage.linkage.encoders import EncoderErrors
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS
from soliton_linkage_nodes.runtime.managed import ManagedParameters


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


PARAMETERS: dict[type, str] = {
    SimulatorParameters: '',
    ManagedParameters: '',
    Gravity: 'gravity.',
    EncoderErrors: 'sensors.',
    **CHAIN_PARAMETERS,
}
"""Dataclasses with the node's parameters, and the prefix of the parameter names of each class."""
