# SPDX-License-Identifier: Apache-2.0
"""What came last grows old by the clock on the wall; what never came is too old."""

from __future__ import annotations

import math

import pytest

from soliton_linkage_nodes.runtime import freshness
from soliton_linkage_nodes.runtime.freshness import Freshness


def test_what_came_grows_old_and_is_renewed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(freshness.time, 'monotonic', lambda: now)
    watched = Freshness(0.5)
    assert (watched.age, watched.stale, str(watched)) == (math.inf, True, 'none has come')
    watched.renew()
    now = 100.5
    assert (watched.age, watched.stale) == (0.5, False)
    now = 101.25
    assert (watched.stale, str(watched)) == (True, 'the last is 1.25 s old')
    watched.renew()
    assert not watched.stale
