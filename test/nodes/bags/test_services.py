# SPDX-License-Identifier: Apache-2.0
"""Services have types of rosbag2 where that is installed, and elsewhere others like them."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from graphs import Graph
from std_srvs.srv import Empty, SetBool, Trigger

from soliton_linkage_msgs import srv
from soliton_linkage_nodes.bags.services import serve, service_type, tell


@pytest.mark.parametrize('name', ['Pause', 'Resume', 'IsPaused', 'SplitBagfile', 'Snapshot'])
def test_without_rosbag2_triggers_stand_in(name: str) -> None:
    assert service_type(name) is Trigger


def test_without_rosbag2_ours_stand_in_where_there_are_fields() -> None:
    for name in ('Seek', 'SetRate', 'GetRate'):
        assert service_type(name) is getattr(srv, name)


def test_with_rosbag2_its_types_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = ModuleType('rosbag2_interfaces.srv')
    module.Pause = Empty
    monkeypatch.setitem(sys.modules, 'rosbag2_interfaces', ModuleType('rosbag2_interfaces'))
    monkeypatch.setitem(sys.modules, 'rosbag2_interfaces.srv', module)
    assert service_type('Pause') is Empty
    assert service_type('Resume') is Trigger


@pytest.mark.parametrize('complaint', [None, 'not now'])
def test_a_service_says_what_is_wrong(graph: Graph, complaint: str | None) -> None:
    serve(graph.user, 'pause', 'Pause', lambda _: complaint)
    response = graph.call(Trigger, 'user/pause')
    assert (response.success, response.message) == (complaint is None, complaint or '')


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ({}, {}),
        ({'success': None}, {'success': False}),
        (
            {'return_code': None, 'error_string': None},
            {'return_code': 1, 'error_string': 'not now'},
        ),
    ],
)
def test_every_form_of_response_is_filled(
    fields: dict[str, Any], expected: dict[str, Any]
) -> None:
    offered: list[Any] = []
    node: Any = SimpleNamespace(create_service=lambda *arguments: offered.append(arguments))
    serve(node, 'pause', 'Pause', lambda _: 'not now')
    ((_, _, respond),) = offered
    assert vars(respond(None, SimpleNamespace(**fields))) == expected


def test_a_value_is_told_in_its_field_or_as_success() -> None:
    offered: list[Any] = []
    node: Any = SimpleNamespace(create_service=lambda *arguments: offered.append(arguments))
    tell(node, 'is_paused', 'IsPaused', 'paused', lambda: True)
    ((_, _, respond),) = offered
    assert respond(None, SimpleNamespace(paused=False)).paused
    assert respond(None, SetBool.Response()).success
