# SPDX-License-Identifier: Apache-2.0
"""A node that was stopped, or is too slow, is behind; clocks that differ make none so."""

from __future__ import annotations

import pytest

from soliton_linkage_nodes.runtime.intake import lag
from soliton_linkage_nodes.runtime.intake.lag import Lag


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [1000.0]
    monkeypatch.setattr(lag.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(lag.time, 'time_ns', lambda: round(now[0] * 1e9))
    return now


@pytest.mark.parametrize('difference', [0.0, -3600.0, 3600.0])
def test_who_is_behind_for_longer_than_may_be_is_told_so(
    clock: list[float], difference: float
) -> None:
    watched = Lag(0.5)
    for _ in range(100):
        clock[0] += 0.01
        assert not watched.too_long(round((clock[0] + difference) * 1e9))
    sent = clock[0]
    clock[0] += 5
    told = []
    for _ in range(100):
        clock[0] += 0.01
        sent += 0.01
        told.append(watched.too_long(round((sent + difference) * 1e9)))
    assert 0.4 < 0.01 * told.index(True) < 0.6
    assert not watched.too_long(round((clock[0] + difference) * 1e9))
