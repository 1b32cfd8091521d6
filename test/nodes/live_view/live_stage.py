# SPDX-License-Identifier: Apache-2.0
"""Nodes that run while a test drives a browser, the browser, and a chain that the test plays."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_to_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

PICTURES = Path(__file__).parents[3] / 'out' / 'live'
LONGEST_WAIT = 60.0


def until(condition: Callable[[], Any], what: str) -> Any:
    """Wait until a condition holds and return what it is then."""
    deadline = time.monotonic() + LONGEST_WAIT
    while not (value := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f'waited {LONGEST_WAIT:g} s for {what}')
        time.sleep(0.01)
    return value


class Stage:
    """Nodes on a domain of their own, spun by a thread while the test drives a browser."""

    def __init__(self, domain: int, folder: Path) -> None:
        self.folder = folder
        self.domain = domain
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.executor = EventsExecutor(context=self.context)
        self._nodes: list[Node] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        self.user = self.start(lambda **kwargs: Node('user', **kwargs))

    def start(
        self, create: Callable[..., Node], parameters: Mapping[str, Any] | None = None, **more: Any
    ) -> Any:
        """Create a node with parameters and spin it."""
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        node = create(context=self.context, parameter_overrides=overrides, **more)
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def hear(self, topic: interfaces.Topic, namespace: str = '/') -> list[Any]:
        """Return a list to which every message of a topic is added from now on."""
        heard: list[Any] = []
        name = namespace + topic.name
        self.user.create_subscription(topic.type, name, heard.append, topic.qos)
        until(lambda: self.user.count_publishers(name), f'a publisher of {name}')
        return heard

    def close(self) -> None:
        """End all of it."""
        self._stopping.set()
        self._thread.join()
        for node in reversed(self._nodes):
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)

    def _spin(self) -> None:
        while not self._stopping.is_set():
            self.executor.spin_once(timeout_sec=0.05)


class Visit:
    """A person at a browser."""

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        self.console: list[str] = []
        self._context = browser.new_context(viewport={'width': 1400, 'height': 1000}, **options)
        self._context.set_default_timeout(60_000)
        self.page = self._context.new_page()
        self.page.on('console', lambda message: self.console.append(message.text))
        self.page.on('pageerror', lambda error: self.console.append(str(error)))
        self.page.on('request', self._check)
        self.address = address
        self.page.goto(address)
        self.wait('window.live && live.drawn > 2 && live.status.chains.length')

    def wait(self, condition: str) -> None:
        self.page.wait_for_function(f'() => {condition}')

    def js(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def click(self, name: str) -> None:
        self.page.click(f'#live-{name}')

    def tab(self, name: str) -> None:
        self.page.get_by_role('tab', name=name).click()

    def fill(self, label: str, value: object) -> None:
        panel = self.page.locator('.q-tab-panel:visible')
        panel.get_by_label(label, exact=True).fill(str(value))
        panel.get_by_label(label, exact=True).press('Tab')

    def choose(self, label: str, option: str) -> None:
        self.page.locator(f'label.q-select:visible:has-text("{label}")').first.click()
        self.page.get_by_role('option', name=option, exact=True).click()

    def panel_says(self, text: str) -> None:
        """Wait until the controls that are open say something."""
        self.page.locator('.q-tab-panel:visible', has_text=text).first.wait_for()

    def text(self, name: str) -> str:
        return self.page.locator(f'#live-{name}').inner_text()

    def painted(self, name: str) -> int:
        """How many colours a canvas has."""
        return self.js(
            f"""(() => {{
            const c = document.getElementById('live-{name}');
            const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            return new Set(new Uint32Array(data.buffer)).size; }})()"""
        )

    def shot(self, name: str) -> None:
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f'{name}.png', full_page=True)

    def place(self, rotor: float) -> tuple[float, float]:
        """Pixels of a place on the chain, well away from all masses."""
        box = self.page.locator('#live-chain').bounding_box()
        share = self.js(f'({rotor} - live.view.first) / (live.view.last - live.view.first)')
        return box['x'] + share * box['width'], box['y'] + box['height'] - 30

    def close(self) -> None:
        self._context.close()

    def _check(self, request: Any) -> None:
        if '127.0.0.1' not in request.url and not request.url.startswith(('data:', 'blob:')):
            self.console.append(f'asked {request.url}')


class Rig:
    """Joints of a chain that the test publishes, in a namespace of their own."""

    def __init__(self, stage: Stage, namespace: str) -> None:
        self.stage, self.namespace = stage, namespace
        self.second = 1
        topic = interfaces.JOINT_STATES
        self.joints: Publisher = stage.user.create_publisher(
            topic.type, f'{namespace}joint_states', topic.qos
        )

    def publish(self, rotors: int) -> None:
        self.second += 1
        names = default_joint_names(rotors)
        named = NamedChain(Chain(number_of_rotors=rotors), names)
        angles = named.chain.uniform_state(1)
        frame = Frame(angles, 0 * angles)
        self.joints.publish(
            frame_to_msg(named, frame, 0 * angles, time_to_msg(self.second * 10**9))
        )
