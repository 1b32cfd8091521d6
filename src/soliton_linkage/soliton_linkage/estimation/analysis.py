# SPDX-License-Identifier: Apache-2.0
"""What an analysis of a frame tells: walls, cycle, and all else."""

from __future__ import annotations

import math
from typing import NamedTuple

from soliton_linkage.estimation.motion_class import MotionClass
from soliton_linkage.estimation.places.orbit_estimate import OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.state_report import EdgeRotors, Energies, Topology
from soliton_linkage.estimation.walls.analysed_soliton import AnalysedSoliton
from soliton_linkage.estimation.walls.soliton_event import SolitonEvent
from soliton_linkage.estimation.wobble import Wobble
from soliton_linkage.linkage.chain import Motion
from soliton_linkage.orbit.orbit import Orbit


class CyclePhase(NamedTuple):
    """Where a chain is on its orbit, as a phase; NaN, and leg -1, where it is not known.

    phase: from 0 to 2 pi over a whole cycle [rad].
    rate: rate of the phase [rad/s].
    phase_deviation: standard deviation of the phase [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    completed: whole cycles since the start, with which the phase grows without jumps.
    leg: leg of the cycle: as the phase grows, the wall leaves rotor 0 in even legs.
    """

    phase: float
    rate: float
    phase_deviation: float
    rate_deviation: float
    completed: int
    leg: int


class Analysis(NamedTuple):
    """What a frame shows, in the light of those before; None and NaN for what cannot be told.

    motion: how a wall moves, by the chain's parameters or, where they are not known, by the
        angles.
    measured_motion: the same by the angles alone.
    status: what the first wall rests on, or the place on the orbit where no wall is listed.
    estimate: where the chain is on its orbit.
    cycle: the same in phase.
    solitons: walls half a spacing or more from the edges, in the order of their place.
    events: what is known of late to have happened to walls.
    topology: of the whole state.
    edge_rotors: of the whole state.
    energies: of the whole state.
    wobble: beside the wall that is on the orbit.
    unseen: number of rotors that the frame did not show.
    """

    motion: Motion | None
    measured_motion: MotionClass
    status: TrackingStatus
    estimate: OrbitEstimate
    cycle: CyclePhase
    solitons: tuple[AnalysedSoliton, ...] = ()
    events: tuple[SolitonEvent, ...] = ()
    topology: Topology | None = None
    edge_rotors: EdgeRotors | None = None
    energies: Energies | None = None
    wobble: Wobble | None = None
    unseen: int = 0


def cycle_phase(estimate: OrbitEstimate, orbit: Orbit | None) -> CyclePhase:
    """Phase of the cycle that an estimate is in.

    Of spinners that were assembled upside down it runs against the arc, so that in either family
    the wall that leaves rotor 0 from the left-leaning state does so in leg 0, forwards.
    """
    if orbit is None or not estimate.leg_known:
        return CyclePhase(math.nan, math.nan, math.nan, math.nan, 0, -1)
    scale = 2 * math.pi / orbit.length
    backwards = estimate.upside_down and orbit.chain.motion is Motion.SPINNER
    sense = -1 if backwards else 1
    completed, phase = divmod(sense * scale * estimate.arc, 2 * math.pi)
    return CyclePhase(
        phase=phase,
        rate=sense * scale * estimate.rate,
        phase_deviation=scale * estimate.arc_deviation,
        rate_deviation=scale * estimate.rate_deviation,
        completed=int(completed) + backwards,
        leg=1 - estimate.leg if backwards else estimate.leg,
    )
