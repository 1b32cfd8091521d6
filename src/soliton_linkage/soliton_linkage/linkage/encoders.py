# SPDX-License-Identifier: Apache-2.0
"""Simulated encoder readings with noise, finite resolution and offsets."""

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
    """Errors of encoder readings. Raises ValueError for values out of range."""

    noise: float = quantity(
        0.0, 'standard deviation of each reading', 'rad', 0.0, 10.0, adjustable=True
    )
    quantisation: float = quantity(
        0.0, 'resolution of the readings; 0 means no rounding', 'rad', 0.0, 10.0, adjustable=True
    )
    offsets: tuple[float, ...] = quantity(
        (), 'constant offset of each encoder, one per rotor [rad]; an empty list means 0 for all'
    )
    seed: int = quantity(0, 'seed of the noise', '', 0, LARGEST_SEED)

    def __post_init__(self) -> None:
        check_quantities(self)
        check_offsets(self.offsets)

    @property
    def none(self) -> bool:
        """Whether all errors are 0, so that the readings equal the angles."""
        return not (self.noise or self.quantisation or any(self.offsets))


@document_fields
@dataclass(frozen=True)
class KnownEncoders:
    """Known offset (reading minus angle) of each encoder; ValueError for values out of range."""

    offsets: tuple[float, ...] = quantity(
        (),
        'known offset (reading minus angle) of each encoder, one per rotor [rad]; an empty list '
        'means 0 for all',
    )

    def __post_init__(self) -> None:
        check_offsets(self.offsets)


class Encoders:
    """Simulated encoders that convert the angles of a chain to readings, frame by frame.

        reading = q round((phi + offset + noise n) / q),    rate = (reading - previous) / period,

    The resolution q, the noise and the offset are values of `EncoderErrors`. The normal random
    number n depends only on the seed, the frame and the rotor. `previous` is the reading in the
    previous frame, and `period` is the time between two frames [s]. If the previous call of `read`
    was not for the previous frame, the rates are 0. Raises ValueError if offsets are given for
    another number of rotors.
    """

    def __init__(self, number_of_rotors: int, period: float, errors: EncoderErrors) -> None:
        check_one_each(errors.offsets, number_of_rotors)
        self.errors = errors
        self._rotors = number_of_rotors
        self._period = period
        self._before: tuple[int, Array] | None = None

    def forget(self) -> None:
        """Set the rates of the next frame to 0, for example because the angles have jumped."""
        self._before = None

    def read(self, frame: int, angles: Array) -> tuple[Array, Array]:
        """Return readings [rad] and rates [rad/s] of a frame, shape (N,) each."""
        errors, step = self.errors, self.errors.quantisation
        reading = angles + (errors.offsets or 0.0)
        if errors.noise:
            bits = np.random.Philox(key=errors.seed, counter=[0, frame, 0, 0])
            reading += errors.noise * np.random.Generator(bits).standard_normal(self._rotors)
        if step:
            reading = step * np.round(reading / step)
        rates = np.zeros(self._rotors)
        if self._before is not None and self._before[0] == frame - 1:
            rates = (reading - self._before[1]) / self._period
        self._before = (frame, reading)
        return reading, rates


def check_one_each(offsets: Sequence[float], number_of_rotors: int) -> None:
    """Raise ValueError unless `offsets` is empty or contains one offset per rotor."""
    if len(offsets) not in (0, number_of_rotors):
        raise ValueError(
            f'{len(offsets)} offsets of encoders do not fit a chain of {number_of_rotors} rotors; '
            'give one per rotor, or none'
        )


def check_offsets(offsets: Sequence[float]) -> None:
    """Raise ValueError for an offset [rad] that is not finite or too large."""
    for rotor, offset in enumerate(offsets):
        if not abs(offset) <= LARGEST_ANGLE:
            raise ValueError(
                f'offset of rotor {rotor} = {offset:g} rad must lie in the range '
                f'{-LARGEST_ANGLE:g} to {LARGEST_ANGLE:g} rad; give reading minus angle'
            )
