# SPDX-License-Identifier: Apache-2.0
"""Readings of encoders on the rotors: noise, resolution and offsets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import (
    LARGEST_ANGLE,
    LARGEST_SEED,
    check_quantities,
    document_fields,
    quantity,
)


@document_fields
@dataclass(frozen=True)
class EncoderErrors:
    """How readings differ from angles; raises ValueError for values out of their range."""

    noise: float = quantity(
        0.0, 'standard deviation of each reading', 'rad', 0.0, 10.0, adjustable=True
    )
    quantisation: float = quantity(
        0.0, 'step between readings, 0 for none', 'rad', 0.0, 10.0, adjustable=True
    )
    offsets: tuple[float, ...] = quantity(
        (), 'what readings are constantly too large by, one a rotor [rad]; empty for nothing'
    )
    seed: int = quantity(0, 'seed of the noise', '', 0, LARGEST_SEED)

    def __post_init__(self) -> None:
        """Refuse values out of their range."""
        check_quantities(self)
        _check_offsets(self.offsets)

    @property
    def none(self) -> bool:
        """Whether readings are the angles."""
        return not (self.noise or self.quantisation or any(self.offsets))


@document_fields
@dataclass(frozen=True)
class KnownEncoders:
    """Known properties of the encoders of a chain; raises ValueError for values out of range.

    Subtract the offsets before readings are used as angles; recordings contain readings.
    """

    offsets: tuple[float, ...] = quantity(
        (),
        'what positions in joint_states are known to be too large by, one a rotor [rad]; empty '
        'for nothing',
    )

    def __post_init__(self) -> None:
        """Refuse values out of their range."""
        _check_offsets(self.offsets)


class Encoders:
    """Reads the angles of a chain frame by frame.

    With normal noise n of unit variance and the quantisation q,

        reading = q round((phi + offset + noise n) / q),
        rate = (reading - reading of the frame before) / period,

    as drivers of encoders have it, which measure no rates: without the frame before it is 0.
    The noise of a frame depends on the seed and the number of the frame alone.
    """

    def __init__(self, number_of_rotors: int, period: float, errors: EncoderErrors) -> None:
        """Read a chain of so many rotors once a period [s]."""
        check_one_each(errors.offsets, number_of_rotors)
        self.errors = errors
        self._rotors = number_of_rotors
        self._period = period
        self._before: tuple[int, Array] | None = None

    def forget(self) -> None:
        """Take the next frame for the first, as after a jump of the angles."""
        self._before = None

    def read(self, frame: int, angles: Array) -> tuple[Array, Array]:
        """Readings [rad] and rates [rad/s] of a frame, given its angles [rad], shape (N,) each."""
        errors = self.errors
        reading = angles + (errors.offsets or 0.0) + self._noise(frame, errors)
        step = errors.quantisation
        if step:
            reading = step * np.round(reading / step)
        rates = np.zeros(self._rotors)
        if self._before is not None and self._before[0] == frame - 1:
            rates = (reading - self._before[1]) / self._period
        self._before = (frame, reading)
        return reading, rates

    def _noise(self, frame: int, errors: EncoderErrors) -> Array:
        if not errors.noise:
            return np.zeros(self._rotors)
        generator = np.random.Generator(
            np.random.Philox(key=errors.seed, counter=[0, frame, 0, 0])
        )
        return errors.noise * generator.standard_normal(self._rotors)


def check_one_each(offsets: Sequence[float], number_of_rotors: int) -> None:
    """Raise ValueError for offsets that are not one a rotor, unless there are none."""
    if len(offsets) not in (0, number_of_rotors):
        raise ValueError(
            f'{len(offsets)} offsets of encoders do not fit a chain of {number_of_rotors} rotors; '
            'give one for each, or none'
        )


def _check_offsets(offsets: Sequence[float]) -> None:
    for rotor, offset in enumerate(offsets):
        if not abs(offset) <= LARGEST_ANGLE:
            raise ValueError(
                f'offset of rotor {rotor} = {offset:g} rad must lie in the range '
                f'{-LARGEST_ANGLE:g} to {LARGEST_ANGLE:g} rad; give what readings are off by'
            )
