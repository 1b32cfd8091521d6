# SPDX-License-Identifier: Apache-2.0
import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest
from hostile_values import BEYOND, PATIENT, TEXTS, messages
from hypothesis import given
from hypothesis import strategies as st
from page_messages import kind_of, unpack
from rclpy.serialization import serialize_message

from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_nodes.live_view import chain_topics
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder
from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.stream import BrowserStream
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.messages.view_conversions import AdjustableParameter, parameter_value
from soliton_linkage_nodes.runtime import interfaces

NUMBERS = st.one_of(st.sampled_from([*BEYOND, 10**400, -(10**400)]), st.integers(), st.floats())
ANYTHING = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.sampled_from([*TEXTS, '/', '*'])),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(TEXTS), inner, max_size=2)
    ),
    max_leaves=4,
)
DEEP = {'deep list': 100_000 * '[', 'deep object': 100_000 * '{"a":'}
KEYS = ('rotor', 'speed', 'edge', 'at', 'paused', 'chain')
ACTIONS = st.fixed_dictionaries(
    {'act': st.sampled_from(['move', 'nudge', 'seek', 'pause', 'other'])},
    optional={name: st.one_of(NUMBERS, ANYTHING) for name in KEYS} | {'chain': st.just('/')},
)
MESSAGES = st.one_of(
    st.sampled_from(['drawn', '', '{', *DEEP, 'NaN', '1']),
    ACTIONS,
    ANYTHING.map(lambda value: {'watch': value}),
    ANYTHING.map(lambda value: {'window': value}),
    st.one_of(st.booleans(), ANYTHING).map(lambda value: {'camera': value}),
    st.lists(NUMBERS, min_size=2, max_size=2).map(lambda value: {'window': value}),
    ANYTHING,
)


SEQUENCES = st.one_of(st.none(), st.integers(0, 2**63 - 1))
RECEIVED = {
    topic.type: st.lists(st.tuples(SEQUENCES, messages(topic.type)), max_size=3)
    for topic in (
        interfaces.CHAIN,
        interfaces.JOINT_STATES,
        interfaces.SOLITON_STATE,
        interfaces.DIAGNOSTICS,
        interfaces.CAMERA_OVERLAY,
    )
}


class DrawnTopic:
    """Subscription that returns messages which hypothesis has drawn."""

    drawn: dict[Any, list[tuple[int | None, Any]]]

    def __init__(
        self, _node: Any, topic: Any, _name: str, raw: bool = False, depth: int = 1
    ) -> None:
        self._type, self._raw = topic.type, raw
        self.sequence: int | None = None
        self.publishers = ['publisher']

    def newest(self) -> Any:
        if not self.drawn[self._type]:
            return None
        self.sequence, message = self.drawn[self._type].pop()
        return serialize_message(message) if self._raw else message

    def waiting(self) -> Iterator[tuple[Any, dict[str, int | None]]]:
        while (message := self.newest()) is not None:
            yield message, {'publication_sequence_number': self.sequence}

    def adapt(self) -> bool:
        return False

    def close(self) -> None:
        pass


class Browser:
    """Browser that sends some messages and records the received ones."""

    def __init__(self, messages: list[str]) -> None:
        self._messages = messages
        self.texts: list[str] = []
        self.frames: list[bytes] = []

    async def send_text(self, data: str) -> None:
        self.texts.append(data)

    async def send_bytes(self, data: bytes) -> None:
        self.frames.append(data)

    async def receive_text(self) -> str:
        await asyncio.sleep(0)
        if not self._messages:
            await asyncio.sleep(0.01)
            raise EOFError
        return self._messages.pop(0)


class SteppedView(View):
    """View that takes messages whenever a stream waits for them."""

    async def wait(self) -> None:
        for chain in self.chains.values():
            chain.camera.adapt()
        self.update(set(self.chains))
        await asyncio.sleep(0.001)


@pytest.fixture
def commands(graph):
    made = ChainCommands(graph.user, '/', False, ChainFinder(graph.user, '/'))
    yield made
    made.close()


def reject(constant: str) -> None:
    raise AssertionError(f'{constant} is not JSON')


def test_a_browser_receives_valid_messages_and_an_answer_to_each_action(
    graph, tmp_path, monkeypatch
):
    monkeypatch.setattr(chain_topics, 'subscribe_newest', DrawnTopic)
    view = SteppedView(graph.user, ChainFinder(graph.user, '/'), [tmp_path], tmp_path, False)

    @PATIENT
    @given(drawn=st.fixed_dictionaries(RECEIVED), messages=st.lists(MESSAGES, max_size=12))
    def survive(drawn: Any, messages: list[Any]) -> None:
        DrawnTopic.drawn = drawn
        browser = Browser(
            [
                DEEP.get(each, each) if isinstance(each, str) else json.dumps(each)
                for each in messages
            ]
        )
        stream = BrowserStream(browser, view)
        with pytest.raises(EOFError):
            asyncio.run(stream.run())
        for text in browser.texts:
            json.loads(text, parse_constant=reject)
        for frame in browser.frames:
            if kind_of(frame) == 'frame':
                unpack(frame)
        actions = sum(isinstance(each, dict) and 'act' in each for each in messages)
        assert sum('"answer"' in text for text in browser.texts) >= actions

    survive()
    view.close()


@PATIENT
@given(kind=st.sampled_from([bool, int, float, str]), value=st.one_of(NUMBERS, ANYTHING))
def test_a_field_value_fits_the_parameter_or_is_rejected(kind, value):
    parameter = AdjustableParameter('p', kind, '', '', Quantity(''))
    try:
        message = parameter_value(parameter, value)
    except ValueError:
        return
    serialize_message(message)


@PATIENT
@given(data=st.data())
def test_commands_with_invalid_numbers_are_rejected_in_one_line(commands, data):
    value = data.draw(NUMBERS)
    text = data.draw(st.sampled_from([*TEXTS, 'kick', 'pressure', 'first', 'angles']))
    for command in (
        lambda: commands.nudge(value),
        lambda: commands.tilt(value),
        lambda: commands.drive(text, 'first', value, (value, 0.0, value)),
        lambda: commands.drive('kick', text, 1.0, (0.0, value, 0.0)),
        lambda: commands.step(value),
        lambda: commands.reset(text, value, value, {text: value}),
        lambda: commands.move_to(value, value, value),
    ):
        with pytest.raises(ValueError, match=r'^[^\n]+$'):
            asyncio.run(command())
