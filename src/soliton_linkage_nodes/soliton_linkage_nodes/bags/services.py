# SPDX-License-Identifier: Apache-2.0
"""Services as rosbag2's recorder and player have them, with its types where it is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from soliton_linkage_msgs.srv import GetRate, Seek, SetRate
from soliton_linkage_nodes.runtime.managed import ManagedNode

_OURS = {'Seek': Seek, 'SetRate': SetRate, 'GetRate': GetRate}


@dataclass(frozen=True)
class Reply:
    """What a service did, in a line, and the figures that its response may have fields for."""

    line: str
    figures: Mapping[str, Any] = field(default_factory=dict)


def serve(node: Node, name: str, type_name: str, act: Callable[[Any], Reply]) -> None:
    """Offer `~/<name>`; `act` takes the request, and raises ValueError where it refuses that.

    A managed node that is not active refuses all.

    What it did, or why it did not, is logged, and told where the response has a field for it. The
    type is that of rosbag2_interfaces, or, where that is not installed, one of the suite with the
    same fields, or std_srvs/Trigger.
    """

    def respond(request: Any, response: Any) -> Any:
        try:
            if isinstance(node, ManagedNode):
                node.check_active()
            done = act(request)
        except ValueError as error:
            node.get_logger().warning(f'~/{name} is refused: {error}')
            return _filled(response, False, str(error))
        node.get_logger().info(f'~/{name}: {done.line}')
        return _filled(response, True, done.line, done.figures)

    node.create_service(service_type(type_name), f'~/{name}', respond)


def tell(node: Node, name: str, type_name: str, field: str, value: Callable[[], Any]) -> None:
    """Offer `~/<name>` that tells a value in a field, or in `success` of std_srvs/Trigger."""

    def respond(_request: Any, response: Any) -> Any:
        told = value()
        node.get_logger().debug(f'~/{name}: {told}')
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


def _filled(
    response: Any, success: bool, line: str, figures: Mapping[str, Any] | None = None
) -> Any:
    values = {
        'success': success,
        'message': line,
        'return_code': 0 if success else 1,
        'error_string': '' if success else line,
        **(figures or {}),
    }
    for name, value in values.items():
        if hasattr(response, name):
            setattr(response, name, value)
    return response
