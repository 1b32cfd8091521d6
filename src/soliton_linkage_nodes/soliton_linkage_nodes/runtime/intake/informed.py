# SPDX-License-Identifier: Apache-2.0
"""Callbacks that are told the number of a message and when it was sent."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

Info = Mapping[str, Any]
"""What the middleware tells of a message, by name."""


class Informed:
    """Callback of a subscription that takes the message and what is told of it.

    rclpy looks at the signature for whether a callback wants both. Its EventsExecutor then hands
    them over as one.
    """

    __signature__ = inspect.Signature(
        [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY)
            for name in ('message', 'info')
        ]
    )

    def __init__(self, take: Callable[[Any, Info], None]) -> None:
        """Have it call another function."""
        self._take = take

    def __call__(self, message: Any, info: Info | None = None) -> None:
        """Take both, maybe as a pair."""
        if info is None:
            message, info = message
        self._take(message, info or {})
