# SPDX-License-Identifier: Apache-2.0
"""Services of recorder and player. Their names and, if installed, their types are from rosbag2."""

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
    """Result of a service call: a line of text, and values for fields of the response by name."""

    line: str
    figures: Mapping[str, Any] = field(default_factory=dict)


def serve(node: Node, name: str, type_name: str, act: Callable[[Any], Reply]) -> None:
    """Offer the service `~/<name>`. A call executes `act` with the request and logs the result.

    The call is rejected if `act` raises ValueError, or if the node is a managed node that is not
    active.
    """

    def respond(request: Any, response: Any) -> Any:
        try:
            if isinstance(node, ManagedNode):
                node.check_active()
            done = act(request)
        except ValueError as error:
            node.get_logger().warning(f'rejected ~/{name}: {error}')
            return _filled(response, False, str(error), {})
        node.get_logger().info(f'~/{name}: {done.line}')
        return _filled(response, True, done.line, done.figures)

    node.create_service(service_type(type_name), f'~/{name}', respond)


def serve_value(
    node: Node, name: str, type_name: str, field: str, value: Callable[[], Any]
) -> None:
    """Offer the service `~/<name>`, which responds with `value()`.

    The value is in the field `field` or, if the service type lacks this field, in `success`.
    """

    def respond(_request: Any, response: Any) -> Any:
        setattr(response, field if hasattr(response, field) else 'success', value())
        return response

    node.create_service(service_type(type_name), f'~/{name}', respond)


def service_type(name: str) -> Any:
    """Return the service type with this name from rosbag2.

    If rosbag2 is not installed, return the type of this software with the same name or, without
    such a type, Trigger.
    """
    try:
        return getattr(importlib.import_module('rosbag2_interfaces.srv'), name)
    except (ImportError, AttributeError):
        return _OURS.get(name, Trigger)


def _filled(response: Any, success: bool, line: str, figures: Mapping[str, Any]) -> Any:
    values = {'success': success, 'message': line, 'return_code': int(not success)}
    values |= {'error_string': '' if success else line, **figures}
    for name, value in values.items():
        if hasattr(response, name):
            setattr(response, name, value)
    return response
