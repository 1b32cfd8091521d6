# SPDX-License-Identifier: Apache-2.0
"""Services as rosbag2's recorder and player have them, with its types where it is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from soliton_linkage_msgs.srv import GetRate, Seek, SetRate

_OURS = {'Seek': Seek, 'SetRate': SetRate, 'GetRate': GetRate}


def serve(node: Node, name: str, type_name: str, act: Callable[[Any], str | None]) -> None:
    """Offer `~/<name>`; `act` takes the request and returns what is wrong, or None.

    The type is that of rosbag2_interfaces, or, where that is not installed, one of the suite with
    the same fields, or std_srvs/Trigger.
    """

    def respond(request: Any, response: Any) -> Any:
        complaint = act(request)
        return _filled(response, complaint is None, complaint or '')

    node.create_service(service_type(type_name), f'~/{name}', respond)


def tell(node: Node, name: str, type_name: str, field: str, value: Callable[[], Any]) -> None:
    """Offer `~/<name>` that tells a value in a field, or in `success` of std_srvs/Trigger."""

    def respond(_request: Any, response: Any) -> Any:
        told = value()
        target = field if hasattr(response, field) else 'success'
        setattr(response, target, told)
        return response

    node.create_service(service_type(type_name), f'~/{name}', respond)


def service_type(name: str) -> Any:
    """Type of a service of rosbag2, or the one that stands in for it."""
    try:
        return getattr(importlib.import_module('rosbag2_interfaces.srv'), name)
    except (ImportError, AttributeError):
        return _OURS.get(name, Trigger)


def _filled(response: Any, success: bool, message: str) -> Any:
    for field, value in (
        ('success', success),
        ('message', message),
        ('return_code', 0 if success else 1),
        ('error_string', message),
    ):
        if hasattr(response, field):
            setattr(response, field, value)
    return response
