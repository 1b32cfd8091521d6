# SPDX-License-Identifier: Apache-2.0
"""How often the thread of the page is busy with pictures."""

from __future__ import annotations

import time

import pytest

pytest.importorskip('nicegui', reason='NiceGUI is not installed')

from fastapi import FastAPI

from soliton_linkage_nodes.live_view.server import PageServer, listening_socket

TICKS, BUSY, PERIOD = 20, 0.005, 0.001
LONGEST_WAIT = 60.0


@pytest.mark.parametrize('share', [0.2, 0.5])
def test_ticks_that_take_long_come_so_seldom_that_others_have_the_rest(share: float) -> None:
    seen: list[tuple[float, float]] = []

    def tick() -> float:
        seen.append((time.thread_time(), time.monotonic()))
        while time.thread_time() < seen[-1][0] + BUSY:
            pass
        return PERIOD

    server = PageServer(FastAPI(), listening_socket('127.0.0.1', 0), '', tick, share)
    try:
        # What it takes to begin is over once it is there.
        first = len(seen) + 1
        deadline = time.monotonic() + LONGEST_WAIT
        while len(seen) <= first + TICKS and time.monotonic() < deadline:
            time.sleep(BUSY)
    finally:
        server.stop()
    (before, begun), (after, ended) = seen[first], seen[first + TICKS]
    assert after - before <= 1.05 * share * (ended - begun)
