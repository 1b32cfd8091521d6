# SPDX-License-Identifier: Apache-2.0
"""Waveforms of a torque or of an imposed angle: bursts, chirps, noise and tables."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.actuation.profile import Profile
from soliton_linkage.linkage.chain import Array

_POINTS_PER_PERIOD = 64
"""Number of profile points per period of the highest frequency [1]. The interpolation error is 0.1
% of the amplitude. Sensitivity: with half this number, the error is four times as large."""
_MOST_POINTS = 200_000
"""Largest number of profile points [1]; the start of a waveform takes 1 ms per 4000 points."""


class WaveShape(enum.Enum):
    """Shape of a waveform."""

    BURST = 'burst'
    """Sine with a given number of periods."""
    CHIRP = 'chirp'
    """Sine whose frequency changes linearly with time."""
    NOISE = 'noise'
    """Random function of time whose frequencies lie in a given band."""
    TABLE = 'table'
    """Given samples, equally spaced in time."""


class WaveWindow(enum.Enum):
    """Shape of the ramps of a waveform."""

    LINEAR = 'linear'
    HANN = 'hann'
    """Ramps in the shape of a raised cosine."""


class DrivenQuantity(enum.Enum):
    """Quantity that a waveform specifies."""

    TORQUE = 'torque'
    """Torque on the rotor [N m]."""
    ANGLE = 'angle'
    """Angle of the rotor minus its angle at the start of the waveform [rad]."""


@dataclass(frozen=True)
class Waveform:
    """Waveform of an `EdgeCommand`; raises ValueError for values that do not fit the shape."""

    shape: WaveShape = WaveShape.BURST
    quantity: DrivenQuantity = DrivenQuantity.TORQUE
    joint: str = ''
    """Name of the driven joint; an empty name means the rotor at the edge."""
    window: WaveWindow = WaveWindow.LINEAR
    frequency: float = 0.0
    """Angular frequency of a burst, first angular frequency of a chirp, or lowest angular
    frequency of noise [rad/s]."""
    last_frequency: float = 0.0
    """Last angular frequency of a chirp, or highest angular frequency of noise [rad/s]."""
    cycles: float = 0.0
    """Number of periods of a burst [1]."""
    seed: int = 0
    """Seed of the random numbers for noise."""
    samples: tuple[float, ...] = ()
    """Samples of a table [1], from -1 to 1."""

    def __post_init__(self) -> None:
        if self.shape is WaveShape.TABLE:
            largest = float(np.max(np.abs(self.samples), initial=0.0))
            if len(self.samples) < 2 or not largest <= 1:
                raise ValueError(
                    f'samples of a table must be 2 or more numbers from -1 to 1, not '
                    f'{len(self.samples)} with the largest {largest:g}; divide them by it and '
                    'multiply value by it'
                )
            return
        needed = ['frequency', 'cycles' if self.shape is WaveShape.BURST else 'last_frequency']
        for name in needed:
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f'{name} of a {self.shape.value} = {getattr(self, name):g} must be a finite '
                    'number above 0'
                )
        if self.shape is WaveShape.NOISE and self.frequency > self.last_frequency:
            raise ValueError(
                f'frequency of noise = {self.frequency:g} rad/s must not exceed last_frequency = '
                f'{self.last_frequency:g} rad/s; exchange them'
            )

    def length(self, given: float) -> float:
        """Return the duration of all `cycles` of a burst; for other shapes, return `given` [s]."""
        if self.shape is WaveShape.BURST:
            return 2 * math.pi * self.cycles / self.frequency
        return given

    def profile(self, amplitude: float, length: float, ramps: tuple[float, float]) -> Profile:
        """Return `amplitude` times the waveform, as a profile with a total duration `length` [s].

        `ramps` are the durations of rise and fall [s]. Raises ValueError for too many points or
        too long ramps.
        """
        if not 0 < length < math.inf:
            raise ValueError(
                f'duration of a {self.shape.value} = {length:g} s must be above 0; specify it'
            )
        if sum(ramps) > length * (1 + 1e-9):
            raise ValueError(
                f'ramps of {sum(ramps):g} s must not be longer than the whole waveform, '
                f'{length:g} s; shorten them'
            )
        times = np.linspace(0.0, length, self._points(length))
        values = amplitude * self._values(times) * self._envelope(times, ramps)
        return Profile(np.append(times, length), np.append(values, 0.0))

    def _points(self, length: float) -> int:
        highest = max(self.frequency, self.last_frequency)
        needed = 1 + max(
            math.ceil(min(_POINTS_PER_PERIOD * highest * length / (2 * math.pi), 1e12)),
            8 * len(self.samples),
            _POINTS_PER_PERIOD,
        )
        if needed > _MOST_POINTS:
            raise ValueError(
                f'a {self.shape.value} of {length:g} s needs {needed} points, the limit is '
                f'{_MOST_POINTS}; shorten it or lower its frequency'
            )
        return needed

    def _values(self, times: Array) -> Array:
        length = float(times[-1])
        if self.shape is WaveShape.TABLE:
            instants = np.linspace(0.0, length, len(self.samples))
            return np.interp(times, instants, self.samples)
        if self.shape is WaveShape.NOISE:
            return self._noise(times)
        slope = 0.0
        if self.shape is WaveShape.CHIRP:
            slope = (self.last_frequency - self.frequency) / length
        return np.sin((self.frequency + slope * times / 2) * times)

    def _noise(self, times: Array) -> Array:
        """Return Gaussian noise with frequencies in the band, scaled to a peak of 1."""
        step = 2 * math.pi / float(times[-1])
        first, last = self.frequency / step, self.last_frequency / step
        numbers = np.arange(len(times) // 2 + 1)
        amplitudes = np.random.default_rng(self.seed).standard_normal((len(numbers), 2))
        inside = (numbers >= first) & (numbers <= last)
        if not inside.any():
            raise ValueError(
                f'noise from {self.frequency:g} to {self.last_frequency:g} rad/s contains no '
                f'multiple of {step:.3g} rad/s; widen the band or lengthen the duration'
            )
        spectrum = np.where(inside, amplitudes @ (1, 1j), 0)
        values = np.fft.irfft(spectrum, len(times) - 1)
        values = np.append(values, values[0])
        return np.asarray(values / np.abs(values).max())

    def _envelope(self, times: Array, ramps: tuple[float, float]) -> Array:
        length = float(times[-1])
        if self.window is WaveWindow.HANN and not any(ramps):
            ramps = length / 2, length / 2
        envelope = np.ones_like(times)
        for since, ramp in ((times, ramps[0]), (length - times, ramps[1])):
            if ramp:
                envelope *= np.clip(since / ramp, 0.0, 1.0)
        if self.window is WaveWindow.HANN:
            envelope = np.sin(math.pi / 2 * envelope) ** 2
        return np.asarray(envelope)
