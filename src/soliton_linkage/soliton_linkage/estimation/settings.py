# SPDX-License-Identifier: Apache-2.0
"""Tuned settings of the estimation, as frozen dataclasses with one class per subject."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from soliton_linkage.linkage.quantities import quantity

LEAST_NOISE = 1e-5
"""Lower limit of the noise of angles [rad]. Smaller changes of a reading do not count."""


def record_dtype(part: Any) -> np.dtype[np.void]:
    """Return a structured type with one float64 field for each scalar of a settings class."""
    names = [each.name for each in fields(part) if each.type in ('float', 'int')]
    return np.dtype([(name, np.float64) for name in names])


class _Part:
    @cached_property
    def record(self) -> np.ndarray[Any, np.dtype[np.void]]:
        """Scalar settings as a read-only structured array, shape (1,)."""
        record = np.zeros(1, record_dtype(self))
        for name in record.dtype.names or ():
            record[name] = getattr(self, name)
        record.flags.writeable = False
        return record


@dataclass(frozen=True)
class NoiseSettings(_Part):
    """Settings that separate noise from residuals that persist from frame to frame."""

    memory: float = quantity(4000, 'number of frames over which the noise of angles is averaged')
    recent_frames: float = quantity(
        60, 'number of recent frames over which the misfit is averaged'
    )
    least_noise: float = quantity(
        LEAST_NOISE, 'lower limit of the estimated noise of angles', 'rad'
    )
    significance: float = quantity(
        4.0,
        'number of standard deviations above which residuals count as persistent, and innovations '
        'as contradictions of a prediction',
    )


@dataclass(frozen=True)
class LikelihoodSettings(_Part):
    """Settings for the probability density of the difference between a rotor and the orbit."""

    bound: float = quantity(
        2.5, 'number of standard deviations above which a difference has less weight'
    )
    wrong: float = quantity(0.01, 'prior probability of a reading without information')
    false_alarms: float = quantity(1e-3, 'accepted probability of a wrong decision in a test')
    gross_share: float = quantity(
        0.3, 'least size of a gross error, relative to the swing of a rotor'
    )
    elastic_share: float = quantity(
        0.03,
        'prior standard deviation of a rotor due to the deformation of a wall by its springs, '
        'relative to the swing of a rotor',
    )
    largest_noise: float = quantity(
        0.25, 'largest possible standard deviation of the noise of an angle', 'rad'
    )
    informative_share: float = quantity(
        0.7, 'a frame is informative if its inliers have at least this share of the information'
    )

    @property
    def field_share(self) -> float:
        """Largest rms distance of a rotor from the orbit without noise, divided by its swing [1].

        It is half of the least gross error.
        """
        return self.gross_share / 2


@dataclass(frozen=True)
class OffsetSettings(_Part):
    """Settings for the estimation of encoder offsets from rotors far from the wall."""

    rest_angle_deviation: float = quantity(
        0.05, 'prior standard deviation of the error of a rest angle', 'rad'
    )
    significance: float = quantity(
        5.5, 'number of standard deviations above which an offset is corrected'
    )
    block: int = quantity(16, 'number of frames over which residuals are averaged')


@dataclass(frozen=True)
class FilterSettings(_Part):
    """Settings for the models of the multiple-model filter and their prior probabilities."""

    rate_changes: tuple[float, ...] = quantity(
        (0.001, 0.006, 0.04, 0.25),
        'random relative change of the rate per rotor spacing in each model; an empty tuple '
        'leaves only the steady model',
    )
    change_at_edges: float = quantity(
        0.03,
        'random relative change of the rate per rotor spacing at edges, for several walls',
    )
    biases: tuple[float, ...] = quantity(
        (1e-4, 1e-3, 4e-3, 0.016, 0.064),
        'standard deviation of the persistent bias of a measurement in each model',
        'rotor spacings',
    )
    bias_way: float = quantity(0.5, 'correlation length of a bias', 'rotor spacings')
    bias_time: float = quantity(
        50.0, 'correlation time of a bias while the wall is at rest, in time units of the chain'
    )
    memory_way: float = quantity(
        20.0,
        'displacement over which log likelihoods of models decay by a factor e',
        'rotor spacings',
    )
    restart_odds: float = quantity(
        6.0,
        'log odds against the steady model at which the steady model restarts, and initial log '
        'odds in favour of it',
    )
    impulse_ages: int = quantity(8, 'number of impulse hypotheses, at ages of 1, 2, 4, ... frames')
    impulse_rarity: float = quantity(
        8.0,
        'prior log odds against an impulse in a frame, and largest log odds in favour of the '
        'steady model',
    )
    decisive_odds: float = quantity(
        15.0,
        'log odds above which a hypothesis replaces another one: an impulse or a position',
    )
    damping: float = quantity(
        0.02,
        'prior standard deviation of an unmodelled damping rate, relative to the rate scale of '
        'the chain',
    )
    disturbance: float = quantity(
        0.0,
        'prior standard deviation of a constant unmodelled acceleration, relative to the squared '
        'rate scale of the chain',
    )


@dataclass(frozen=True)
class TrackingSettings(_Part):
    """Settings for the gating, the acquisition and the loss of a wall."""

    confirming_frames: int = quantity(
        3,
        'number of successive frames that confirm a new wall or the loss of a wall, and largest '
        'number of immediately successive searches of the orbit after a pause',
    )
    clock_limit: float = quantity(
        1.0, 'largest delay of a late frame; a larger delay restarts the clock', 's'
    )
    settled: float = quantity(
        10.0,
        'number of frames in which the initial uncertainty of the deformation of a wall '
        'decreases by a factor e',
    )
    loss_time: float = quantity(
        0.1, 'time without an accepted frame after which the wall is lost', 's'
    )
    wave_weight: float = quantity(
        12.0,
        'weight of the squared amplitude of waves in `ResidualVariance.calm`, which reduces the '
        'weight of the steady model',
    )
    scan_rate: float = quantity(
        20.0, 'largest mean rate of searches of the orbit in recorded time', '1/s'
    )


@dataclass(frozen=True)
class MotionSettings(_Part):
    """Settings for the evidence that is required to report a class of motion."""

    least_probability: float = quantity(0.95, 'least probability of a reported class of motion')
    fewest_rotors: float = quantity(
        4, 'a frame is used only if more rotors than this are between the wall and each edge'
    )
    strongest_frame: float = quantity(
        10.0, 'upper limit of the absolute log likelihood ratio of one frame'
    )
    strongest: float = quantity(
        30.0, 'upper limit of the absolute log likelihood ratio of all frames together'
    )


@dataclass(frozen=True)
class WidthSettings(_Part):
    """Settings for the fit of the contraction of a moving wall, and for its mean over fits."""

    span: float = quantity(
        6,
        'range of the fit on either side of the wall, divided by the penetration depth or the '
        'rotor spacing, whichever is larger',
    )
    memory: float = quantity(
        5, 'number of passages over which weights in the mean decay by a factor e'
    )
    typical_scatter: float = quantity(
        0.01, 'prior standard deviation of ln(gamma) between passages and between frames'
    )


@dataclass(frozen=True)
class WallSettings(_Part):
    """Settings for the detection of several walls, and thresholds of events."""

    domain_bonds: float = quantity(
        2.5, 'least number of adjacent bonds of equal polarisation that form a domain'
    )
    inside: float = quantity(
        0.5, 'least distance of a reported wall from an edge', 'rotor spacings'
    )
    edge_patience: float = quantity(
        3.0,
        'longest time that a wall may be unseen at an edge, relative to the time of a reflection',
    )
    longest_wait: float = quantity(
        60.0, 'longest time that a wall may be unseen at an edge, in absolute terms', 's'
    )
    lump_share: float = quantity(
        0.25, 'least swing of a rotor in a breather, relative to the swing while a wall passes'
    )
    quiet_periods: float = quantity(
        2.0,
        'two overlapping walls count as annihilated after this number of phonon periods in '
        'which no rotor swings as in a breather',
    )
    breather_collisions: float = quantity(
        4, 'two walls count as a breather after this number of collisions'
    )


@dataclass(frozen=True)
class EstimationSettings:
    """All tuned settings of the estimation, with one field per subject."""

    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    offsets: OffsetSettings = field(default_factory=OffsetSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    width: WidthSettings = field(default_factory=WidthSettings)
    walls: WallSettings = field(default_factory=WallSettings)


DEFAULTS = EstimationSettings()
