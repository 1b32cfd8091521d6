# SPDX-License-Identifier: Apache-2.0
"""Tuned parameters of the steering, with the sensitivity of moves to each parameter.

The sensitivities were measured with flippers, wobbling flippers and spinners of 12 rotors. These
chains had friction and a disorder of 3 to 6 %. Frames had a period of 10 ms, and angles had a
noise of 0.01 to 0.02 rad. Each parameter was halved (0.5x) and doubled (2x) separately.
"""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import CheckedQuantities, quantity


@dataclass(frozen=True)
class SteeringSettings(CheckedQuantities):
    """Tuned parameters of the steering; raises ValueError for values out of range.

    The `Quantity` of each field contains its meaning and range. In the docstrings of the fields, b
    is the bandwidth of the feedback [rad/s], and an error is the distance of the soliton from the
    reference trajectory.
    """

    tolerance: float = quantity(
        0.1, 'distance from the goal below which a soliton has arrived', 'rotor spacings', 1e-6
    )
    """Sensitivity: at 0.5x, arrivals are reported up to 4 s later; at 2x, up to 0.6 s earlier. The
    accuracy of the final position does not change."""

    latency: int = quantity(1, 'delay from a frame until its torques act', 'frames', 0)
    """Sensitivity: a value that is wrong by 2 frames has no effect; with a value that is wrong by
    5 frames, the soliton may be lost."""

    radiated_share: float = quantity(
        1e-5, 'fraction of the energy of a soliton that one rotor may radiate', '', 1e-12, 1.0
    )
    """Sensitivity: at 0.5x, moves take up to 7 % longer. At 2x, moves of a wobbling flipper take
    28 % less time and leave 2000 times as much phonon energy (1e-6 of the soliton energy)."""

    adiabatic_fraction: float = quantity(
        0.5,
        'ratio of the adiabatic rate to the rate at which radiated_share is radiated',
        '',
        1e-3,
        1.0,
    )
    """Sensitivity: at 0.5x, the duration of moves increases by up to a factor 2; at 2x, it
    decreases by up to a factor 2. At 2x, the ratio of the phonon energy to the soliton energy
    rises from 3e-11 to 5e-8 for a flipper and from 3e-10 to 2e-4 for a wobbling flipper."""

    bandwidth_share: float = quantity(
        0.125, 'ratio of the bandwidth of the feedback to the phonon gap', '', 1e-3, 1.0
    )
    """Sensitivity: at 0.5x, errors in disordered chains are four times as large, and some solitons
    are lost. At 2x, noise causes six times the torques and 15 to 170 times the phonon energy."""

    bandwidth_step: float = quantity(
        0.1, 'largest bandwidth of the feedback times the frame period', '', 1e-3, 1.0
    )
    """The parameter limits the bandwidth if the frame period is longer than `bandwidth_step` /
    (`bandwidth_share` times the phonon gap). The feedback is then stable for delays of up to 3
    frames. Sensitivity for a frame period of 50 ms: at 0.5x, moves take twice as long; at 2x, a
    delay of 3 frames destabilises the feedback for a flipper."""

    observer_ratio: float = quantity(
        3.0, 'ratio of the bandwidths of observer and feedback', '', 0.1, 100.0
    )
    """Sensitivity: at 0.5x, torques due to noise are a third as large, and errors in disordered
    chains are four times as large. At 2x, noise causes 4 times the torques, and 10 to 50 times the
    phonon energy."""

    period_memory: float = quantity(
        50.0, 'number of frames over which the frame period is averaged', 'frames', 1.0
    )
    """Sensitivity: at 0.5x or 2x, there is no effect if the frame period is constant. For a frame
    period of 50 ms that varies by a third, the duration of a move changes by 2 %."""

    min_duration: float = quantity(
        10.0, 'shortest duration of a reference trajectory times the bandwidth', '', 1.0
    )
    """Sensitivity: at 0.5x, short moves take 0.6 times as long and have the same errors; at 2x,
    they take up to 1.8 times as long. The required torques are proportional to the inverse square
    of this parameter. Therefore some goals become unreachable if it is smaller."""

    force_reserve: float = quantity(
        2.0, 'ratio of the available force to the force of the trajectory', '', 1.0
    )
    """The excess over 1 is a margin for noise and disturbances. Sensitivity: at 0.5x, the reported
    reach of actuators at an edge is ln(2) penetration depths longer; at 2x, the reach is ln(2)
    penetration depths shorter."""

    settling_time: float = quantity(
        3.0,
        'time within the tolerance after which a soliton counts as at rest, times the bandwidth',
        '',
        0.0,
    )
    """In the time 3 / b, an error decays to the fraction (1 + 3) e^-3 = 0.2. Sensitivity: at 0.5x,
    arrivals are reported 1.5 / b earlier, with up to six times the error; at 2x, they are reported
    3 / b later."""

    settling_timeout: float = quantity(
        30.0, 'longest time to settle after the trajectory, times the bandwidth', '', 0.0
    )
    """Sensitivity: at 0.5x, a soliton that never settles is reported after half the time; at 2x,
    it is reported after twice the time. All others settle in less than half of the timeout."""

    max_error: float = quantity(
        1.5,
        'distance of the soliton from the reference above which the reference restarts at the '
        'soliton',
        'rotor spacings',
        1e-3,
    )
    """Sensitivity: at 0.5x, the reference also restarts for a lag of 0.9 rotor spacings in a
    disordered chain, or for an impulse that displaces the soliton by 0.8 rotor spacings. At 2x,
    the torques before a restart are larger."""

    max_restarts: int = quantity(
        20, 'number of restarts after which a soliton that does not settle is lost', '', 0
    )
    """The reference restarts if the soliton is farther than `max_error` from it. After missing
    frames, one to three restarts are enough. A load that exceeds the force of the actuators
    displaces the soliton until this number of restarts is reached; the soliton is then released.
    Sensitivity in a long chain: at 0.5x, such a load displaces the soliton by 15 rotor spacings
    less before the release; at 2x, by 30 rotor spacings more. These displacements are the changes
    of `max_restarts` times `max_error`. In a short chain, the soliton reaches an edge before."""

    max_gap: float = quantity(
        5.0, 'time without frames after which the soliton may have moved', 'frame periods', 1.0
    )
    """After a shorter gap, a soliton that is lost is released at once. After a longer gap, it is
    released only if it is not found within twice the `detection_timeout`. Sensitivity: at 0.5x, a
    soliton that an impulse displaces while two frames are missing is not released; at 2x, a
    soliton that moves while eight frames are missing is released."""

    detection_timeout: float = quantity(
        0.2, 'time without a frame that shows the soliton, after which it is lost', 's', 0.0
    )
    """Sensitivity: at 0.5x, the soliton is lost after 0.15 s without frames; at 2x, it is not lost
    after 0.35 s without frames."""

    min_noise: float = quantity(
        3e-3, 'lower limit of the noise of an angle in the observer', 'rad', 1e-9
    )
    """This limit is for frames without noise. Without the limit, the filter would treat the start
    of an impulse as noise, and an impulse of 6 to 10 rad/s would displace a soliton 1.4 times as
    far. Sensitivity: at 0.5x and 2x, there is no effect."""

    phonon_periods: float = quantity(
        4.0,
        'number of the longest phonon periods over which the phonon energy is averaged',
        'periods',
        0.1,
    )
    """The average removes the oscillation of the kinetic energy of a phonon. Sensitivity: at 0.5x,
    the estimate oscillates twice as much, and converges twice as fast."""


DEFAULTS = SteeringSettings()
"""Tuned values of the steering."""
