# SPDX-License-Identifier: Apache-2.0
"""Sine and cosine to fifty digits, to judge rounding errors by."""

from __future__ import annotations

import decimal
from decimal import Decimal

DIGITS = 50


def sine_and_cosine(angle: float) -> tuple[Decimal, Decimal]:
    """Return sin and cos of an angle below a few turns [rad], from their Taylor series."""
    with decimal.localcontext() as context:
        context.prec = DIGITS + 10
        x = Decimal(angle)
        term, order, sums = Decimal(1), 0, [Decimal(0), Decimal(0)]
        while order < 20 or abs(term) > Decimal(10) ** -(DIGITS + 5):
            sums[order % 2] += -term if order % 4 > 1 else term
            order += 1
            term *= x / order
        return sums[1], sums[0]
