# SPDX-License-Identifier: Apache-2.0
"""Services have the types of rosbag2 if it is installed, otherwise equivalent types."""

import sys
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import pytest
from rclpy.logging import get_logger
from std_srvs.srv import Empty, SetBool, Trigger

from soliton_linkage_msgs import srv
from soliton_linkage_nodes.bags.services import Reply, serve, serve_value, service_type


class Offering:
    """A stub of a node for a service."""

    def create_service(self, _type: Any, _name: str, respond: Any) -> None:
        self.respond = respond

    def get_logger(self) -> Any:
        return get_logger('offering')


def act(complaint: str | None, _request: Any) -> Reply:
    if complaint:
        raise ValueError(complaint)
    return Reply('it is done')


@pytest.fixture(autouse=True)
def without_rosbag2(monkeypatch):
    for name in ('rosbag2_interfaces', 'rosbag2_interfaces.srv'):
        monkeypatch.setitem(sys.modules, name, None)


def test_without_rosbag2_triggers_stand_in():
    for name in ['Pause', 'Resume', 'IsPaused', 'SplitBagfile', 'Snapshot']:
        assert service_type(name) is Trigger


def test_without_rosbag2_ours_stand_in_where_there_are_fields():
    for name in ('Seek', 'SetRate', 'GetRate'):
        assert service_type(name) is getattr(srv, name)


def test_with_rosbag2_its_types_are_taken(monkeypatch):
    module: Any = ModuleType('rosbag2_interfaces.srv')
    module.Pause = Empty
    monkeypatch.setitem(sys.modules, 'rosbag2_interfaces', ModuleType('rosbag2_interfaces'))
    monkeypatch.setitem(sys.modules, 'rosbag2_interfaces.srv', module)
    assert service_type('Pause') is Empty
    assert service_type('Resume') is Trigger


@pytest.mark.parametrize('complaint', [None, 'not now'])
def test_a_service_returns_and_logs_its_result_or_error(graph, complaint, capfd):
    serve(graph.user, 'pause', 'Pause', partial(act, complaint))
    response = graph.call(service_type('Pause'), 'user/pause')
    told = (response.success, response.message)
    assert told == (complaint is None, complaint or 'it is done')
    line = f'rejected ~/pause: {complaint}' if complaint else '~/pause: it is done'
    assert line in capfd.readouterr().err


def test_every_form_of_response_is_filled():
    for fields, expected in [
        ({}, {}),
        ({'success': None}, {'success': False}),
        (
            {'return_code': None, 'error_string': None},
            {'return_code': 1, 'error_string': 'not now'},
        ),
    ]:
        node = Offering()
        serve(cast(Any, node), 'pause', 'Pause', partial(act, 'not now'))
        assert vars(node.respond(None, SimpleNamespace(**fields))) == expected


def test_figures_fill_the_fields_that_a_response_has():
    node = Offering()
    serve(cast(Any, node), 'burst', 'Burst', lambda _: Reply('7 messages', {'actually_burst': 7}))
    assert node.respond(None, SimpleNamespace(actually_burst=0)).actually_burst == 7
    response = node.respond(None, Trigger.Response())
    assert (response.success, response.message) == (True, '7 messages')


def test_a_value_is_returned_in_its_field_or_as_success():
    node = Offering()
    serve_value(cast(Any, node), 'is_paused', 'IsPaused', 'paused', lambda: True)
    assert node.respond(None, SimpleNamespace(paused=False)).paused
    assert node.respond(None, SetBool.Response()).success
