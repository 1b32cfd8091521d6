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
from rclpy.service import Service
from rclpy.timer import Timer

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_to_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

PICTURES = Path(__file__).parents[4] / 'out' / 'live'
LONGEST_WAIT = 60.0
ROTORS, PLACE = 12, 5.5
SIMULATED = {
    'chain.number_of_rotors': ROTORS,
    'publish_rate': 50.0,
    'initial_state': 'soliton',
    'initial_place': PLACE,
}


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
        self._heard: dict[str, list[Any]] = {}
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

    def listen(self, topic: interfaces.Topic, namespace: str = '/') -> Any:
        """Keep what is published on a topic for `hear`, and return the subscription."""
        heard: list[Any] = []
        self._heard[topic.name] = heard
        name = f'{namespace}{topic.name}'
        return self.user.create_subscription(topic.type, name, heard.append, topic.qos)

    def hear(self, topic: interfaces.Topic) -> list[Any]:
        """Return a list to which every message of a topic is added from now on."""
        heard = self._heard[topic.name]
        heard.clear()
        return heard

    def call(self, name: str, service_type: Any, request: Any) -> Any:
        """Answer of a service."""
        client = self.user.create_client(service_type, name)
        until(client.service_is_ready, name)
        answer = client.call_async(request)
        until(answer.done, f'the answer of {name}')
        self.user.destroy_client(client)
        return answer.result()

    def end(self, timer: Timer, *others: Publisher | Service[Any, Any]) -> None:
        """Destroy a timer, then what it uses, in turns of the executor.

        A timer that is due when it is destroyed calls back once more.
        """
        self._in_turn(lambda: self.user.destroy_timer(timer))
        destroy = (self.user.destroy_publisher, self.user.destroy_service)
        self._in_turn(lambda: [any(act(each) for act in destroy) for each in others])

    def close(self) -> None:
        """End all of it."""
        self._stopping.set()
        self._thread.join()
        for node in reversed(self._nodes):
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)

    def _in_turn(self, act: Callable[[], object]) -> None:
        until(self.executor.create_task(act).done, 'a turn of the executor')

    def _spin(self) -> None:
        while not self._stopping.is_set():
            self.executor.spin_once(timeout_sec=0.05)


class Browser:
    """A browser that is closed and opened anew where it hangs."""

    def __init__(self, launch: Callable[[], Any]) -> None:
        self._launch = launch
        self._opened = launch()

    def new_context(self, **options: Any) -> Any:
        return self._opened.new_context(**options)

    def reopen(self) -> None:
        self.close()
        self._opened = self._launch()

    def close(self) -> None:
        self._opened.close()


class Visit:
    """A person at a browser."""

    def __init__(self, browser: Browser, address: str, **options: Any) -> None:
        self.address = address
        self._options = options
        self.open(browser)

    def open(self, browser: Browser) -> None:
        """Open the page in a browser."""
        self.console: list[str] = []
        self._context = browser.new_context(
            viewport={'width': 1400, 'height': 1000}, **self._options
        )
        self._context.set_default_timeout(60_000)
        self.page = self._context.new_page()
        self.page.on('console', lambda message: self.console.append(message.text))
        self.page.on('pageerror', lambda error: self.console.append(str(error)))
        self.page.on('request', self._check)
        self.begin()

    def begin(self) -> None:
        """Open the page anew."""
        self.page.goto(self.address)
        self.wait('window.live && live.drawn > 2 && live.status.chains.length')

    def wait(self, condition: str) -> None:
        self.page.wait_for_function(f'() => {condition}')

    def js(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def click(self, name: str) -> None:
        self.page.click(f'#live-{name}')

    def tab(self, name: str) -> None:
        self.page.get_by_role('tab', name=name).click()

    def field(self, label: str) -> Any:
        return self.page.locator('.q-tab-panel:visible').get_by_label(label, exact=True)

    def fill(self, label: str, value: object) -> None:
        self.field(label).fill(str(value))
        self.field(label).press('Tab')

    def shows(self, label: str, value: str) -> None:
        """Wait until a field shows what the server has put there."""
        field = self.field(label)
        until(lambda: field.input_value() == value, f'{label} to be {value}')

    def choose(self, label: str, option: str) -> None:
        select = self.page.locator(f'label.q-select:visible:has-text("{label}")').first
        wanted = self.page.get_by_role('option', name=option, exact=True)
        # A list closes where the page moves under it.
        until(lambda: select.click() or _appears(wanted), f'{option} in the list of {label}')
        wanted.click()

    def panel_says(self, text: str) -> None:
        """Wait until the controls that are open say something."""
        self.page.locator('.q-tab-panel:visible', has_text=text).first.wait_for()

    def says(self, name: str, text: str) -> None:
        """Wait until an element has a text."""
        self.wait(f'document.getElementById("live-{name}").textContent.includes({text!r})')

    def told(self, text: str) -> None:
        """Wait until the page tells what became of something."""
        self.page.locator('.q-notification', has_text=text).first.wait_for()

    def text(self, name: str) -> str:
        return self.page.locator(f'#live-{name}').inner_text()

    def painted(self, name: str) -> int:
        """How many colours a canvas has."""
        plot = 'view' if name == 'chain' else f'plots.{name}'
        return self.js(
            """(() => {
            const { canvas } = live.PLOT;
            const { width, height } = canvas.element;
            const c = new OffscreenCanvas(width, height).getContext('2d');
            c.drawImage(canvas.element, 0, 0);
            const { data } = c.getImageData(0, 0, width, height);
            return new Set(new Uint32Array(data.buffer)).size; })()""".replace('PLOT', plot)
        )

    def shot(self, name: str) -> None:
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f'{name}.png', full_page=True)

    def mass(self, rotor: int) -> tuple[float, float]:
        """Pixels of the mass of a rotor."""
        box = self.page.locator('#live-chain').bounding_box()
        _, x, y, _ = self.js(f'live.view.places()[{rotor}]')
        return box['x'] + x, box['y'] + y

    def resize(self, width: int, height: int) -> None:
        """Give the window another size, and wait until all is drawn for that."""
        self.page.set_viewport_size({'width': width, 'height': height})
        before = self.js('live.drawn')
        self.wait(f'live.drawn > {before + 4}')

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


def _appears(element: Any) -> bool:
    try:
        element.wait_for(timeout=3000)
    except Exception as error:
        if type(error).__name__ != 'TimeoutError':
            raise
        return False
    return True


class Rig:
    """Joints of a chain that the test publishes, in a namespace of their own."""

    def __init__(self, stage: Stage, namespace: str) -> None:
        self.user = stage.user
        self._stage = stage
        self.second = 1
        topic = interfaces.JOINT_STATES
        self.joints: Publisher = self.user.create_publisher(
            topic.type, f'{namespace}joint_states', topic.qos
        )
        self._rotors = 0
        self._timer = self.user.create_timer(0.1, self._publish)

    def go(self, rotors: int) -> None:
        """Publish so many again and again."""
        self._rotors = rotors

    def stop(self) -> None:
        """Publish no more."""
        self._rotors = 0

    def close(self) -> None:
        self._stage.end(self._timer, self.joints)

    def _publish(self) -> None:
        if not self._rotors:
            return
        self.second += 1
        named = NamedChain(Chain(number_of_rotors=self._rotors), default_joint_names(self._rotors))
        angles = named.chain.uniform_state(1)
        frame = Frame(angles, 0 * angles)
        self.joints.publish(
            frame_to_msg(named, frame, 0 * angles, time_to_msg(self.second * 10**8))
        )
