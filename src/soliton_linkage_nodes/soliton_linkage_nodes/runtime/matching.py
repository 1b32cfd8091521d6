# SPDX-License-Identifier: Apache-2.0
"""Waiting for somebody to publish to."""

from __future__ import annotations

import threading
import time

from rclpy.publisher import Publisher

_POLL_INTERVAL = 0.02
"""Between two looks at who listens [s]: short to a person, long to a processor."""
_TIME_TO_MEET_ANOTHER = 1.0
"""Without a further subscriber, after which none is expected [s]: discovery takes less."""


def wait_for_subscriber(
    publisher: Publisher,
    seconds: float,
    stopping: threading.Event | None = None,
    fewest: int = 1,
) -> bool:
    """Wait until a topic has a subscriber, or as many as asked for.

    False where it has not in time, or is told to stop.

    Subscribers are met one after the other, so that after the first one it waits until no
    other has come for a second.
    """
    stopped = stopping or threading.Event()
    deadline = time.monotonic() + seconds
    met, met_at = 0, 0.0
    while met < fewest or time.monotonic() - met_at < _TIME_TO_MEET_ANOTHER:
        matched = publisher.get_subscription_count()
        if matched != met:
            met, met_at = matched, time.monotonic()
        elif met < fewest and time.monotonic() > deadline:
            return False
        if stopped.wait(_POLL_INTERVAL):
            return False
    return True
