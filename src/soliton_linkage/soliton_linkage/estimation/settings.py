# SPDX-License-Identifier: Apache-2.0
"""The numbers of the estimation that were chosen: one frozen dataclass, a part for each subject.

`described_fields(FilterSettings)` gives the unit and the meaning of each. Loops take a part as
its `record`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from soliton_linkage.linkage.quantities import quantity


def record_dtype(part: Any) -> np.dtype[np.void]:
    """Structured type of the single numbers of a part, all as float64."""
    names = [each.name for each in fields(part) if each.type in ('float', 'int')]
    return np.dtype([(name, np.float64) for name in names])


class _Part:
    """Settings that loops take as a record."""

    @cached_property
    def record(self) -> np.ndarray[Any, np.dtype[np.void]]:
        """The single numbers as a structured array, shape (1,)."""
        record = np.zeros(1, record_dtype(self))
        for name in record.dtype.names or ():
            record[name] = getattr(self, name)
        record.flags.writeable = False
        return record


@dataclass(frozen=True)
class NoiseSettings(_Part):
    """How noise of angles and rates is told from what lasts."""

    memory: float = quantity(4000, 'frames over which the noise of angles is averaged')
    recent_frames: float = quantity(20, 'frames over which the misfit of late is averaged, or')
    recent_time: float = quantity(0.25, 'time over which it is, where that is more frames', 's')
    least_noise: float = quantity(1e-5, 'least noise of angles that is estimated', 'rad')
    significance: float = quantity(4.0, 'standard deviations from which on what lasts is believed')


@dataclass(frozen=True)
class LikelihoodSettings(_Part):
    """Density of the difference of a rotor from the orbit."""

    bound: float = quantity(2.5, 'deviations beyond which a difference counts less and less')
    wrong: float = quantity(0.01, 'share of readings that are anything')
    false_alarms: float = quantity(1e-3, 'share of frames with as many that is refused')
    gross_share: float = quantity(0.3, 'difference that no springs make, in swings of a rotor')
    longest_run: int = quantity(2, 'rotors side by side that may be wrong in one frame')
    elastic_share: float = quantity(
        0.03, 'what springs may do to a wall before it is known, in swings of a rotor'
    )
    field_share: float = quantity(
        0.15, 'largest deviation beside noise that a frame may have, in swings of a rotor'
    )
    largest_noise: float = quantity(0.25, 'largest noise that is taken for one', 'rad')
    least_share: float = quantity(0.2, 'least share of t^2 of rotors that are not doubtful')
    believed: float = quantity(0.7, 'least share of the information that must be believed')


@dataclass(frozen=True)
class OffsetSettings(_Part):
    """How offsets of encoders are learnt from rotors far from the wall."""

    rest_angle_deviation: float = quantity(
        0.05, 'prior standard deviation of the difference of a rest angle', 'rad'
    )
    significance: float = quantity(5.5, 'standard deviations from which on an offset is sure')
    fewest_means: float = quantity(5, 'means of blocks that must have shown an offset')
    block: int = quantity(16, 'frames whose residuals are averaged')
    depths_beside: float = quantity(3.0, 'distance of far rotors from the wall, ell / a')
    wave_time: float = quantity(10.0, 'time for which waves are alike, in units of the chain')
    wave_share: float = quantity(0.05, 'share of waves that is the same in all frames')
    least_error: float = quantity(3e-4, 'error that is the same in all frames, at least', 'rad')
    least_doubted: float = quantity(0.01, 'least distance from the orbit to be doubted', 'rad')
    evenness: float = quantity(
        4e-3, 'lasting residuals up to which the chain is taken for even', 'rad'
    )


@dataclass(frozen=True)
class FilterSettings(_Part):
    """Models of the multiple-model filter, and when one is believed."""

    rate_changes: tuple[float, ...] = quantity(
        (0.001, 0.004, 0.016, 0.064, 0.25),
        'share e by which a rate changes from rotor to rotor; with none a steady one is left',
    )
    change_at_edges: float = quantity(0.03, 'what is added to e where springs meet an edge')
    biases: tuple[float, ...] = quantity(
        (1e-4, 1e-3, 4e-3, 0.016, 0.064), 'lasting errors m of measurement, in rotor spacings'
    )
    bias_way: float = quantity(0.5, 'way on which a bias falls by e', 'rotor spacings')
    way_remembered: float = quantity(
        10.0, 'way on which likelihoods of models fall by e', 'rotor spacings'
    )
    odds_of_doubt: float = quantity(
        6.0, 'log odds against the steady model at which it begins anew'
    )
    least_odds_at_edges: float = quantity(-2.0, 'least log odds against it at an edge')
    least_odds: float = quantity(-9.0, 'least log odds against it elsewhere')
    kick_ages: int = quantity(8, 'hypotheses of a kick, at ages of 1, 2, 4, ... frames')
    kick_rarity: float = quantity(8.0, 'log odds against a kick in a frame')
    kick_evidence: float = quantity(1.5, 'log odds for a kick from which on it has a weight')
    kick_beyond_chance: float = quantity(15.0, 'log odds for a kick at which all follow it')
    least_kick: float = quantity(
        0.1, 'least standard deviation of the change of rate, in rates of the chain'
    )
    disturbance: float = quantity(
        0.0, 'deviation of a force that lasts, over inertia and squared rates of the chain'
    )


@dataclass(frozen=True)
class TrackingSettings(_Part):
    """When a frame is taken for one of the orbit, and where the chain is looked for."""

    gate: float = quantity(4.0, 'deviations beyond which two positions are not the same')
    decisive_odds: float = quantity(12.0, 'log odds at which a position is decided')
    confirming_frames: int = quantity(3, 'frames in a row that confirm a change')
    clock_limit: float = quantity(1.0, 'time by which late frames go back, and no clock', 's')
    field_ratio: float = quantity(
        3.0, 'largest square of what lasts about a wall, over its mean: it is not even'
    )
    settled: float = quantity(10.0, 'frames in which what springs do to a wall is known')
    edge_ratio: float = quantity(4.0, 'how much more its variance is at edges')
    doubted_time: float = quantity(0.1, 'time without an explained frame that is lost', 's')
    edge_rotors: float = quantity(2.0, 'reach of an edge beside ell / a', 'rotor spacings')
    beside_share: float = quantity(
        0.08, 'share of what a frame is beside the orbit by which the arc is unsure'
    )
    wave_doubt: float = quantity(
        12.0, 'how much less a wall is taken for steady, over waves as strong as its motion'
    )


@dataclass(frozen=True)
class ScanSettings(_Part):
    """How the places that a frame may show are found."""

    step: float = quantity(0.05, 'step along the orbit, in swings of a rotor')
    deviation: float = quantity(0.1, 'deviation of a rotor that is scanned with, in swings')
    near: float = quantity(0.5, 'distance up to which a sample is of a place', 'rotor spacings')
    told: float = quantity(0.9, 'least probability of the places of a frame that tells any')
    rate: float = quantity(20.0, 'scans in a second of stamps', '1/s')
    burst: float = quantity(3.0, 'scans that may be made at once after a while')


@dataclass(frozen=True)
class MotionSettings(_Part):
    """What frames have to show for their class of motion to be told."""

    sure: float = quantity(0.95, 'least probability of a class that is told')
    fewest_rotors: float = quantity(4, 'rotors between a wall and an edge, which tell nothing')
    leaning: float = quantity(3.0, 'deviations by which either side must lean')
    least_noise: float = quantity(1e-6, 'least noise of a frame', 'rad')
    strongest_frame: float = quantity(10.0, 'log likelihood that one frame may give')
    strongest: float = quantity(30.0, 'log likelihood that all may give: errors may last')
    flat: float = quantity(0.02, 'deviations of a tail at least, in rest angles')
    flat_in_noise: float = quantity(2.0, 'the same, in noise')
    noisiest: float = quantity(0.15, 'noise from which on tails tell nothing, in rest angles')
    bend: float = quantity(0.1, 'standard deviation of the term in e^2, times the rest angle')
    spread: float = quantity(1.2, "variance of e' - F(e) over that of noise")
    neglected: float = quantity(0.01, 'what springs in motion may do to the ratio of tails')


@dataclass(frozen=True)
class WobbleSettings(_Part):
    """Which rotors tell the wobble beside a wall."""

    least_noise: float = quantity(1e-12, 'least noise, that of rounding', 'rad')
    calm: float = quantity(1e-3, 'deviation of a rotor at rest at least, in rest angles')
    largest: float = quantity(0.5, 'largest deviation in a tail, in rest angles')
    above_noise: float = quantity(4.0, 'smallest deviation in a tail, over the noise')
    bend: float = quantity(0.3, 'how far a deviation moves a zero, in rest angles')
    certain: float = quantity(3.0, 'deviations from 0 of a ratio that tells a decay length')
    coarsest: float = quantity(0.2, 'largest relative deviation of a decay length')


@dataclass(frozen=True)
class WidthSettings(_Part):
    """How the contraction of a moving wall is fitted and averaged."""

    span: float = quantity(6, 'rotors that are fitted on either side, in spacings or ell / a')
    clear: float = quantity(2, 'least distance from an edge, in widths or ell')
    close: float = quantity(0.02, 'step that is the last, in standard deviations')
    closest: float = quantity(1e-5, 'the same for exact angles')
    degenerate: float = quantity(1e-12, 'least determinant, over that of independent derivatives')
    coarsest: float = quantity(math.log(1.5), 'largest standard deviation of ln(gamma) told')
    least_deviation: float = quantity(3e-4, 'least deviation of the mean: shapes have errors')
    least_noise: float = quantity(1e-6, 'least noise of angles', 'rad')
    memory: float = quantity(5, 'passages over which the mean fades by e')
    passages: int = quantity(30, 'the last, which tell their scatter')
    fewest_passages: int = quantity(4, 'of them at least')
    typical_scatter: float = quantity(0.01, 'scatter of passages until then, and of frames')
    significance: float = quantity(2.5, 'deviations from which on scatter is no chance')
    contradiction: float = quantity(6.0, 'deviations at which a passage begins a new mean')
    widest_lean_ratio: float = quantity(
        2.0, 'lean ratio d from which on only spinners have a width: psi has no tanh'
    )


@dataclass(frozen=True)
class WallSettings(_Part):
    """How several walls are told apart, and what counts as an event."""

    opposite: float = quantity(
        2.5, 'bonds side by side of the opposite lean that are a domain, a wall on either side'
    )
    scan_beside: float = quantity(1.5, 'way beside a border that is scanned', 'rotor spacings')
    core: float = quantity(
        2.5, 'distance from a wall of the rotors that it has to explain', 'rotor spacings'
    )
    near_depths: float = quantity(8.0, 'distance of two walls that are not free, in ell / a')
    near_beside: float = quantity(4.0, 'the same beside that', 'rotor spacings')
    edge_rotors: float = quantity(5.0, 'reach of an edge', 'rotor spacings')
    edge_widths: float = quantity(2.0, 'the same beside that, in widths')
    edge_patience: float = quantity(3.0, 'times that a wall may take to turn back at an edge')
    longest_wait: float = quantity(60.0, 'time that it may take at most', 's')
    lump_share: float = quantity(0.25, 'swing of a rotor in a breather, over that in a wall')
    quiet_periods: float = quantity(2.0, 'periods of the slowest phonon without such a swing')
    breather_collisions: float = quantity(4, 'collisions of walls that do not part')


@dataclass(frozen=True)
class ReportSettings(_Part):
    """What of a state counts to a wall, and what is told at all."""

    reach_in_depths: float = quantity(
        8, 'reach of a wall: no more than e^-16 of its energy is beyond', 'ell / a'
    )
    reach_beside: float = quantity(
        3, 'reach beside that, which holds the core where ell vanishes', 'rotor spacings'
    )
    domain: float = quantity(0.5, 'polarisation of a bond in a domain, over the uniform one')
    inside: float = quantity(0.5, 'least distance of a wall from an edge', 'rotor spacings')
    fastest: float = quantity(1e9, 'largest rate that is one', 'rad/s')


@dataclass(frozen=True)
class EstimationSettings:
    """All numbers of the estimation that were chosen, in parts by subject."""

    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    offsets: OffsetSettings = field(default_factory=OffsetSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    scan: ScanSettings = field(default_factory=ScanSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    wobble: WobbleSettings = field(default_factory=WobbleSettings)
    width: WidthSettings = field(default_factory=WidthSettings)
    walls: WallSettings = field(default_factory=WallSettings)
    report: ReportSettings = field(default_factory=ReportSettings)


DEFAULTS = EstimationSettings()
