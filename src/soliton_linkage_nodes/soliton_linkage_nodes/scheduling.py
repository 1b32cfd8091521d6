# SPDX-License-Identifier: Apache-2.0
"""Which threads go before others."""

from __future__ import annotations

import contextlib
import os

_LOWEST_PRIORITY = 1


def go_first(first: bool) -> None:
    """Let the calling thread go before all ordinary ones, or no longer.

    It asks for the lowest real-time priority (SCHED_FIFO), for which a user needs the limit
    rtprio. Where the system does not allow that, nothing changes.
    """
    policy = os.SCHED_FIFO if first else os.SCHED_OTHER
    priority = os.sched_param(_LOWEST_PRIORITY if first else 0)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, priority)
