# SPDX-License-Identifier: Apache-2.0
"""Tuned settings of the estimation: a frozen dataclass with one part per subject.

`described_fields(FilterSettings)` gives the unit and the meaning of each field. Compiled loops
take a part as its `record`. Numbers that need no tuning are constants in the modules.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from soliton_linkage.linkage.quantities import quantity


def record_dtype(part: Any) -> np.dtype[np.void]:
    """Return the structured type of the scalars of a part, all as float64."""
    names = [each.name for each in fields(part) if each.type in ('float', 'int')]
    return np.dtype([(name, np.float64) for name in names])


class _Part:
    """Part of the settings with a record for compiled loops."""

    @cached_property
    def record(self) -> np.ndarray[Any, np.dtype[np.void]]:
        """Scalars as a read-only structured array, shape (1,)."""
        record = np.zeros(1, record_dtype(self))
        for name in record.dtype.names or ():
            record[name] = getattr(self, name)
        record.flags.writeable = False
        return record


@dataclass(frozen=True)
class NoiseSettings(_Part):
    """Separation of noise from persistent residuals."""

    memory: float = quantity(4000, 'number of frames in the average of the noise of angles')
    recent_frames: float = quantity(60, 'number of frames in the average of the recent misfit')
    least_noise: float = quantity(1e-5, 'lower limit of the estimated noise of angles', 'rad')
    significance: float = quantity(
        4.0, 'standard deviations above which a residual counts as persistent'
    )


@dataclass(frozen=True)
class LikelihoodSettings(_Part):
    """Density of the difference of a rotor from the orbit."""

    bound: float = quantity(2.5, 'standard deviations above which a difference is down-weighted')
    wrong: float = quantity(0.01, 'prior probability of a reading without information')
    false_alarms: float = quantity(1e-3, 'rate of false alarms of a test')
    gross_share: float = quantity(0.3, 'size of a gross error relative to the swing of a rotor')
    elastic_share: float = quantity(
        0.03, 'prior deformation of a wall by its springs, relative to the swing of a rotor'
    )
    field_share: float = quantity(
        0.15, 'largest distance from the orbit without noise, relative to the swing of a rotor'
    )
    largest_noise: float = quantity(0.25, 'largest noise of an angle', 'rad')
    informative_share: float = quantity(
        0.7, 'least fraction of the information of a frame that remains without outliers'
    )


@dataclass(frozen=True)
class OffsetSettings(_Part):
    """Estimation of encoder offsets from rotors far from the wall."""

    rest_angle_deviation: float = quantity(
        0.05, 'prior standard deviation of the error of a rest angle', 'rad'
    )
    significance: float = quantity(5.5, 'standard deviations above which an offset is corrected')
    block: int = quantity(16, 'number of frames in a block of averaged residuals')


@dataclass(frozen=True)
class FilterSettings(_Part):
    """Models of the multiple-model filter and their prior probabilities."""

    rate_changes: tuple[float, ...] = quantity(
        (0.001, 0.006, 0.04, 0.25),
        'relative changes of the rate per rotor; if empty, only the steady model is used',
    )
    change_at_edges: float = quantity(0.03, 'additional relative change of the rate at edges')
    biases: tuple[float, ...] = quantity(
        (1e-4, 1e-3, 4e-3, 0.016, 0.064), 'persistent biases of a measurement', 'rotor spacings'
    )
    bias_way: float = quantity(0.5, 'correlation length of a bias', 'rotor spacings')
    memory_way: float = quantity(
        20.0,
        'displacement over which log likelihoods of models decay by a factor e',
        'rotor spacings',
    )
    restart_odds: float = quantity(6.0, 'log odds against the steady model at which it restarts')
    impulse_ages: int = quantity(8, 'number of impulse hypotheses, at ages of 1, 2, 4, ... frames')
    impulse_rarity: float = quantity(8.0, 'prior log odds against an impulse in a frame')
    impulse_odds: float = quantity(
        15.0, 'log odds of an impulse at which all filters restart from it'
    )
    damping: float = quantity(
        0.02,
        'prior deviation of an unmodelled damping, relative to the rate scale of the chain',
    )
    disturbance: float = quantity(
        0.0, 'standard deviation of a constant acceleration, relative to the squared rate scale'
    )


@dataclass(frozen=True)
class TrackingSettings(_Part):
    """Gating, acquisition and loss of a wall."""

    gate: float = quantity(4.0, 'gate of an innovation in standard deviations')
    decisive_odds: float = quantity(
        12.0, 'log odds of the best position above which the others are discarded'
    )
    confirming_frames: int = quantity(
        3, 'number of successive frames that confirm a new wall or a loss'
    )
    clock_limit: float = quantity(1.0, 'largest step back of a late frame', 's')
    settled: float = quantity(
        10.0, 'number of frames after which the deformation of a wall is known'
    )
    loss_time: float = quantity(0.1, 'time without an accepted frame until loss', 's')
    wave_weight: float = quantity(
        12.0,
        'weight of waves against the motion of the wall, where they limit trust in a steady wall',
    )
    scan_rate: float = quantity(20.0, 'searches of the orbit per second of stamps', '1/s')
    scan_burst: float = quantity(3.0, 'number of searches without a delay after a pause')


@dataclass(frozen=True)
class MotionSettings(_Part):
    """Evidence required for a class of motion."""

    least_probability: float = quantity(0.95, 'least probability of a reported class')
    fewest_rotors: float = quantity(
        4, 'least number of rotors between a wall and an edge; nearer walls give no evidence'
    )
    strongest_frame: float = quantity(10.0, 'largest log likelihood ratio of a frame')
    strongest: float = quantity(30.0, 'largest log likelihood ratio of all frames')


@dataclass(frozen=True)
class WidthSettings(_Part):
    """Fit and average of the contraction of a moving wall."""

    span: float = quantity(
        6, 'range of the fit on either side of the wall, in penetration depths or spacings'
    )
    memory: float = quantity(
        5, 'number of passages over which weights in the mean decay by a factor e'
    )
    typical_scatter: float = quantity(0.01, 'prior relative scatter of passages and of frames')
    contradiction: float = quantity(
        6.0, 'standard deviations above which a passage restarts the mean'
    )


@dataclass(frozen=True)
class WallSettings(_Part):
    """Detection of several walls, and thresholds of events."""

    domain_bonds: float = quantity(2.5, 'number of adjacent opposite bonds that form a domain')
    inside: float = quantity(0.5, 'least distance of a wall from an edge', 'rotor spacings')
    edge_patience: float = quantity(
        3.0, 'longest time of a wall at an edge, relative to the time of a reflection'
    )
    longest_wait: float = quantity(60.0, 'upper limit of this time', 's')
    lump_share: float = quantity(
        0.25, 'swing of a rotor in a breather, relative to that in a wall'
    )
    quiet_periods: float = quantity(
        2.0, 'phonon periods without such a swing after which a breather has decayed'
    )
    breather_collisions: float = quantity(4, 'number of collisions that form a breather')


@dataclass(frozen=True)
class EstimationSettings:
    """All tuned settings of the estimation, by subject."""

    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    offsets: OffsetSettings = field(default_factory=OffsetSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    width: WidthSettings = field(default_factory=WidthSettings)
    walls: WallSettings = field(default_factory=WallSettings)


DEFAULTS = EstimationSettings()
