# SPDX-License-Identifier: Apache-2.0
"""Every number of the steering that was chosen, and what moves of walls do where it is another.

Found with flippers, wobbling flippers and spinners of 12 rotors, in frames of 10 ms with a noise
of 0.01 to 0.02 rad, friction and deviations of 3 to 6 %, each number halved (/ 2) and doubled
(x 2) by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import check_quantities, quantity


@dataclass(frozen=True)
class SteeringSettings:
    """Numbers that the steering was tuned with; raises ValueError where they are out of range.

    Each is described by its `Quantity`. The bandwidth is that of the feedback, b [rad/s].
    """

    tolerance: float = quantity(
        0.1, 'distance from its goal at which a wall has arrived', 'rotor spacings', 1e-6
    )
    """/ 2: arrivals are told later, by nothing to 4 s; x 2: up to 0.6 s earlier. Walls are held
    alike."""

    latency: int = quantity(1, 'frames after theirs from which torques act', 'frames', 0)
    """That of the loop: 2 frames off it is held as well, 5 off a wall may be lost."""

    radiated_share: float = quantity(
        1e-5, "share of a wall's energy that one rotor may radiate", '', 1e-12, 1.0
    )
    """/ 2: moves take up to 7 % longer; x 2: a wobbling flipper's take 28 % less and leave 2000
    times the energy of phonons, still a millionth of the wall's."""

    adiabatic_fraction: float = quantity(
        0.5, 'gentle rate over that at which a wall radiates this share', '', 1e-3, 1.0
    )
    """/ 2: moves take up to twice as long; x 2: up to half as long, and phonons keep 5e-8 of a
    flipper's energy for 3e-11, 2e-4 of a wobbling flipper's for 3e-10."""

    bandwidth_share: float = quantity(
        0.125, 'bandwidth of the feedback over the gap of the phonons', '', 1e-3, 1.0
    )
    """/ 2: walls of disordered chains are held four times worse and some are lost; x 2: noise
    makes six times the torques and 15 to 170 times the phonons."""

    bandwidth_step: float = quantity(
        0.1, 'largest bandwidth of the feedback times the period of the frames', '', 1e-3, 1.0
    )
    """A margin of stability: torques may come 3 frames late, at x 2 they make a flipper in frames
    of 50 ms unstable; / 2 moves in such frames take twice as long. Faster frames know nothing of
    it."""

    observer_ratio: float = quantity(
        3.0, 'bandwidth of the observer over that of the feedback', '', 0.1, 100.0
    )
    """/ 2: a third of the torques by noise, and errors four times larger in disordered chains;
    x 2: four times the torques by noise, and 10 to 50 times the phonons."""

    period_memory: float = quantity(
        50.0, 'frames over which the period of the frames is averaged', 'frames', 1.0
    )
    """/ 2 and x 2: nothing in even frames, 2 % of the time of a move in frames of 50 ms that
    jitter by a third."""

    shortest_move: float = quantity(
        10.0, 'least duration of a reference trajectory times the bandwidth', '', 1.0
    )
    """/ 2: short moves take 0.6 of the time with the same errors, x 2 up to 1.8 times; long ones
    at the gentle rate know nothing of it. Below, torques grow as its square and goals go out of
    reach."""

    force_reserve: float = quantity(
        2.0, 'force that actuators must have over what the trajectory takes', '', 1.0
    )
    """What is left for noise and disturbances. / 2 and x 2: actuators at an edge are said to
    reach ln(2) penetration depths further and less far; moves that are made are the same."""

    rest: float = quantity(
        3.0,
        'time within the tolerance after which a wall rests, times the bandwidth',
        '',
        0.0,
    )
    """Errors have decayed by (1 + 3) e^-3 = 0.2. / 2: arrivals are told 1.5 / b earlier, with up
    to six times the error; x 2: 3 / b later, with no smaller one."""

    rest_timeout: float = quantity(
        30.0, 'time to come to rest in after the trajectory, times the bandwidth', '', 0.0
    )
    """/ 2 and x 2: walls that never rest are said not to be held so much earlier and later; all
    others arrive within 15."""

    largest_error: float = quantity(
        1.5,
        'distance from the reference at which that begins anew from where the wall is',
        'rotor spacings',
        1e-3,
    )
    """/ 2: a wall in a disordered chain that lags by 0.9, or a blow that makes 0.8, begins its way
    anew; x 2: torques are larger before it does."""

    most_restarts: int = quantity(
        20, 'beginnings anew after which a wall that does not come to rest is lost', '', 0
    )
    """/ 2 and x 2: a wall that is pushed harder than its actuators pull is let go 15 rotor
    spacings earlier, 30 later; one that frames went missing of needs one to three."""

    gap: float = quantity(
        5.0, 'time without frames after which a wall may be elsewhere', 'periods of them', 1.0
    )
    """/ 2: a wall that is put elsewhere where two frames are missing is carried on; x 2: one that
    runs on during a gap of 8 frames is let go."""

    seen_timeout: float = quantity(
        0.2, 'time without a frame that shows the wall after which it is lost', 's', 0.0
    )
    """How long frames may be missing: / 2 a gap of 0.15 s loses the wall, x 2 one of 0.35 s does
    not and its error stays the same."""

    least_noise: float = quantity(
        3e-3, 'noise of an angle that the observer reckons with at least', 'rad', 1e-9
    )
    """In exact frames the first of a blow seems noise, which the filter comes to expect. / 2 and
    x 2: nothing; without it a blow of 6 to 10 rad/s takes a wall 1.4 times as far."""

    phonon_periods: float = quantity(
        4.0, 'memory of the phonons over the longest period of one', 'periods', 0.1
    )
    """Kinetic energy swings about its half of the whole within half a period: / 2 it shows twice
    as much of that and is as much sooner right."""

    def __post_init__(self) -> None:
        """Refuse numbers out of their range."""
        check_quantities(self)


DEFAULTS = SteeringSettings()
"""The numbers as they were tuned."""
