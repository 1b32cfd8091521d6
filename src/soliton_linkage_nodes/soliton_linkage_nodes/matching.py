# SPDX-License-Identifier: Apache-2.0
"""Waiting for somebody to publish to."""

from __future__ import annotations

import threading
import time

from rclpy.publisher import Publisher

_POLL_INTERVAL = 0.02


def wait_for_subscriber(
    publisher: Publisher, seconds: float, stopping: threading.Event | None = None
) -> bool:
    """Wait until a topic has a subscriber; False where it has none in time or is told to stop."""
    stopped = stopping or threading.Event()
    deadline = time.monotonic() + seconds
    while not publisher.get_subscription_count():
        if time.monotonic() > deadline or stopped.wait(_POLL_INTERVAL):
            return False
    return True
