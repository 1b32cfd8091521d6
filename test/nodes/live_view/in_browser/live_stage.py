# SPDX-License-Identifier: Apache-2.0
"""Nodes, a browser and simulated joints for the tests of the page."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from graphs import Graph
from joint_frames import frame_of
from programs import LONGEST_WAIT, until
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

ROTORS, PLACE = 12, 5.5
FRAME_PERIOD = 0.08
SIMULATED = {
    'chain.number_of_rotors': ROTORS,
    'publish_rate': 50.0,
    'initial_state': 'soliton',
    'initial_position': PLACE,
}


class Stage(Graph):
    """Nodes on a separate domain, spun by a thread while the test controls a browser."""

    def __init__(self, domain: int, folder: Path) -> None:
        super().__init__(domain)
        self.folder = folder
        self._received: dict[str, list[Any]] = {}
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def until(
        self, condition: Callable[[], Any], what: str, found: Callable[[], Any] | None = None
    ) -> None:
        until(condition, what, found)

    def subscribe(self, topic: interfaces.Topic, namespace: str = '/') -> Any:
        """Subscribe to a topic for `record`, and return the subscription."""
        received: list[Any] = []
        self._received[topic.name] = received
        name = f'{namespace}{topic.name}'
        return self.user.create_subscription(topic.type, name, received.append, topic.qos)

    def record(self, topic: interfaces.Topic) -> list[Any]:
        """Return a list to which every further message of a topic is added."""
        received = self._received[topic.name]
        received.clear()
        return received

    def end(self, timer: Timer, *others: Publisher | Service[Any, Any]) -> None:
        """Destroy a timer, then the publishers and services that it uses, on the executor.

        A timer that is due when it is destroyed calls back once more.
        """
        self._run_on_executor(lambda: self.user.destroy_timer(timer))
        destroy = (self.user.destroy_publisher, self.user.destroy_service)
        self._run_on_executor(lambda: [any(act(each) for act in destroy) for each in others])

    def close(self) -> None:
        self._stopping.set()
        self._thread.join()
        super().close()

    def _run_on_executor(self, act: Callable[[], object]) -> None:
        until(self._executor.create_task(act).done, 'the executor')

    def _spin(self) -> None:
        while not self._stopping.is_set():
            self._executor.spin_once(timeout_sec=0.05)


class SteeredClock:
    """Clock of a simulator that awaits the torques of each steered frame before the next frame.

    The delay of the torques in simulated time is then independent of the speed of the machine.
    """

    def __init__(self, stage: Stage, simulator: Simulator, steering: SolitonSteering) -> None:
        self._simulator, self._steering = simulator, steering
        self._awaited = False
        topic = interfaces.ROTOR_TORQUES
        stage.user.create_subscription(topic.type, topic.name, self._receive, topic.qos)
        simulator.loop.stop()
        stage.user.create_timer(FRAME_PERIOD, self._tick)

    def _receive(self, _: JointState) -> None:
        self._awaited = False

    def _tick(self) -> None:
        if not (self._awaited and self._steering.holding):
            self._awaited = self._steering.holding
            self._simulator.control.tick()


class Browser:
    """Browser that can be restarted after it hangs."""

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
    """Page in a browser, with the actions of a user."""

    def __init__(self, browser: Browser, address: str, **options: Any) -> None:
        self.address = address
        self._options = options
        self.open(browser)

    def open(self, browser: Browser) -> None:
        self.console: list[str] = []
        # An animation is drawn 60 times per second, twelve times as often as the frames.
        self._context = browser.new_context(
            viewport={'width': 1400, 'height': 1000}, reduced_motion='reduce', **self._options
        )
        self._context.set_default_timeout(1000 * LONGEST_WAIT)
        self.page = self._context.new_page()
        self.page.on('console', lambda message: self.console.append(message.text))
        self.page.on('pageerror', lambda error: self.console.append(str(error)))
        self.page.on('request', self._check)
        self.load()

    def load(self) -> None:
        self.page.goto(self.address)
        self.wait('window.live && live.drawn > 2 && live.status.chains.length')

    def wait(self, condition: str) -> None:
        from playwright import sync_api

        try:
            self.page.wait_for_function(f'() => {condition}')
        except sync_api.TimeoutError:
            shown = self.js('[live.answers.log, document.getElementById("live-move").textContent]')
            pytest.fail(f'waited {LONGEST_WAIT:g} s for {condition}; the page shows {shown}')

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

    def slide(self, name: str, value: float, reached: Callable[[], Any] = lambda: True) -> None:
        """Press arrow keys on a slider until it has a value and a condition is true.

        A slider ignores keys while it is disabled, and a list that closes takes the focus.
        """
        slider = self.page.locator(f'#live-{name}')
        enabled = slider.locator('[tabindex="0"]')
        frame = 'new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))'

        def done() -> bool:
            present = float(slider.get_attribute('aria-valuenow'))
            if math.isclose(present, value, abs_tol=1e-9):
                return bool(reached())
            enabled.press('ArrowRight' if present < value else 'ArrowLeft')
            self.js(frame)
            return False

        until(done, f'the slider {name} to be at {value:g}')

    def has_value(self, label: str, value: str) -> None:
        field = self.field(label)
        until(lambda: field.input_value() == value, f'{label} to be {value}')

    def choose(self, label: str, option: str) -> None:
        from playwright import sync_api

        select = self.page.locator(f'label.q-select:visible:has-text("{label}")').first
        wanted = self.page.get_by_role('option', name=option, exact=True)

        def done() -> bool:
            # A list closes if the page moves, and changes if a node appears.
            with suppress(sync_api.TimeoutError):
                select.click(timeout=3000)
                wanted.click(timeout=3000)
            return bool(select.locator('.q-field__native').inner_text().strip() == option)

        until(done, f'{option} in the list of {label}')

    def panel_has_text(self, text: str) -> None:
        self.page.locator('.q-tab-panel:visible', has_text=text).first.wait_for()

    def has_text(self, name: str, text: str) -> None:
        self.wait(f'document.getElementById("live-{name}").textContent.includes({text!r})')

    def answers(self, text: str) -> None:
        """Wait until the answer to an action contains a text."""
        self.wait(f'live.answers.log.some((answer) => answer.includes({text!r}))')

    def tells_effect(self, text: str) -> None:
        """Wait for the effect of a command, or for its acceptance if the effect is late."""
        texts = ', '.join(map(repr, (text, 'edge_actuator accepted it')))
        self.wait(f'live.answers.log.some((answer) => [{texts}].some((t) => answer.includes(t)))')

    def text(self, name: str) -> str:
        return self.page.locator(f'#live-{name}').inner_text()

    def colours(self, name: str) -> int:
        """Return the number of colours of a canvas."""
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

    def mass(self, rotor: int) -> tuple[float, float]:
        """Return the pixels of the mass of a rotor."""
        box = self.page.locator('#live-chain').bounding_box()
        _, x, y, _ = self.js(f'live.view.masses()[{rotor}]')
        return box['x'] + x, box['y'] + y

    def resize(self, width: int, height: int) -> None:
        self.page.set_viewport_size({'width': width, 'height': height})
        before = self.js('live.drawn')
        self.wait(f'live.drawn > {before + 4}')

    def place(self, rotor: float) -> tuple[float, float]:
        """Return pixels at a site of the chain, away from all masses."""
        box = self.page.locator('#live-chain').bounding_box()
        share = self.js(f'({rotor} - live.view.first) / (live.view.last - live.view.first)')
        return box['x'] + share * box['width'], box['y'] + box['height'] - 30

    def close(self) -> None:
        self._context.close()

    def _check(self, request: Any) -> None:
        if '127.0.0.1' not in request.url and not request.url.startswith(('data:', 'blob:')):
            self.console.append(f'requested {request.url}')


class Rig:
    """Publisher of joint_states in a namespace."""

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
        self._rotors = rotors

    def stop(self) -> None:
        self._rotors = 0

    def close(self) -> None:
        self._stage.end(self._timer, self.joints)

    def _publish(self) -> None:
        if not self._rotors:
            return
        self.second += 1
        named = NamedChain(Chain(number_of_rotors=self._rotors), default_joint_names(self._rotors))
        angles = named.chain.uniform_state(1)
        self.joints.publish(frame_of(named, angles, self.second * 10**8, 0 * angles))
