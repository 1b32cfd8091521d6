# SPDX-License-Identifier: Apache-2.0
"""Guided experiments on a simulated chain.

A nudge is an edge_command of the kind 'kick' at the edge that is nearest to the zero mode.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses

DISORDERED = '/disordered/'
_SPEED = 10.0
"""Angular speed of a nudge [rad/s] in all experiments except `speed`."""
_SPEEDS = (5.0, 10.0, 20.0)
"""Angular speeds of the three nudges in the experiment `speed` [rad/s]."""
_DISORDER = 0.02
"""Relative standard deviation of the rotor lengths in the disordered chain [1]."""
_MIDDLE = (0.3, 0.7)
"""Positions between which the soliton speed is measured, far from the edges [chain lengths]."""
_TIMEOUT = 60.0
"""Longest wait in each step of an experiment [s], for example for a passage of the soliton."""
_CONNECTION_TIME = 10.0
"""Time for which a rejected nudge is sent again [s]. A new edge_actuator needs time to connect."""
_NODES = ('simulator', 'edge_actuator', 'soliton_analyser')
_TURN = 1.0
"""A rotor spins if two passages of the soliton, there and back, turn it by more than this angle
[rad]. Otherwise it flips back."""


class Sample(NamedTuple):
    """State of the soliton at one time."""

    stamp: float
    rotor: float
    """Position of the soliton [rotor spacings]."""
    zero_mode: float
    """Centre of the zero mode [rotor spacings]."""
    turn: float


def velocity(samples: Sequence[Sample]) -> float:
    """Return the velocity of the soliton, positive towards the last rotor [rotor spacings/s]."""
    stamps = np.array([each.stamp for each in samples])
    rotors = np.array([each.rotor for each in samples])
    return float(np.polyfit(stamps - stamps[0], rotors, 1)[0])


class Laboratory:
    """Experiments on the chain in a namespace. Each experiment returns its result as a text.

    `watch` is a function that makes the page show the chain in another namespace.
    """

    def __init__(self, view: View, namespace: str, watch: Callable[[str], None]) -> None:
        self._view, self._namespace, self._watch = view, namespace, watch

    async def nudge(self) -> str:
        """Send a soliton through the chain. Report its speed and its energy."""
        passage = await self._send(_SPEED)
        energy = self._view.chains[self._namespace].model.numbers.get('wall_energy', math.nan)
        return (
            f'A soliton crossed the chain at {abs(velocity(passage)):.2f} rotors/s with an energy '
            f'of {1e3 * energy:.2f} mJ.'
        )

    async def speed(self) -> str:
        """Compare the speeds of the soliton after nudges of three strengths."""
        speeds = [abs(velocity(await self._send(strength))) for strength in _SPEEDS]
        pairs = zip(_SPEEDS, speeds, strict=True)
        measured = ', '.join(f'{s:g} rad/s: {v:.2f} rotors/s' for s, v in pairs)
        ratio = speeds[-1] / speeds[0]
        factor = _SPEEDS[-1] / _SPEEDS[0]
        return (
            f'{measured}. With {factor:g} times the nudge the soliton is {ratio:.2f} times as '
            'fast.'
        )

    async def turns(self) -> str:
        """Determine whether the returning soliton turns the middle rotor back or further."""
        first = await self._send(_SPEED)
        second = await self._passage()
        before, there = first[0].turn, first[-1].turn
        back = second[-1].turn
        kind = 'spins' if abs(back - before) > _TURN else 'flips back'
        return (
            f'The middle rotor turned by {there - before:+.2f} rad, and by '
            f'{back - there:+.2f} rad when the soliton returned. It {kind}.'
        )

    async def reflection(self) -> str:
        """Compare velocity and zero mode before and after the reflection of the soliton."""
        there = await self._send(_SPEED)
        back = await self._passage()
        ends = [passage[-1].zero_mode for passage in (there, back)]
        return (
            f'The velocity was {velocity(there):+.2f} rotors/s before the edge and '
            f'{velocity(back):+.2f} rotors/s after it. The zero mode moved with the soliton: it '
            f'was at rotor {ends[0]:.1f} before and at rotor {ends[1]:.1f} after the reflection.'
        )

    async def disorder(self) -> str:
        """Compare the soliton speeds in this chain and in a chain with random rotor lengths."""
        named = self._view.chains[self._namespace].model.named
        if named is None:
            raise ValueError('the chain is unknown: no node publishes the topic chain')
        regular = await self._send(_SPEED)
        processes = ChildProcesses(Path(self._view.logs))
        fields = {name: getattr(named.chain, name) for name in described_fields(Chain)}
        given = [
            each
            for name, value in fields.items()
            for each in ('-p', f'chain.{name}:={str(value).lower()}')
        ]
        given += ['-p', f'chain.disorder.rotor_length:={_DISORDER}']
        given += ['-p', 'chain.disorder.seed:=1', '-r', f'__ns:={DISORDERED.rstrip("/")}']
        try:
            for node in _NODES:
                processes.start(node, given if node == 'simulator' else given[-2:], {**os.environ})
            await self._until(lambda: self._ready(DISORDERED), 'the disordered chain to start')
            self._watch(DISORDERED)
            other = Laboratory(self._view, DISORDERED, self._watch)
            try:
                passage = await other._send(_SPEED)
            except TimeoutError:
                rotor = self._view.chains[DISORDERED].model.numbers.get('rotor', math.nan)
                return (
                    f'Lengths that deviate by {_DISORDER:.0%} stopped the soliton at rotor '
                    f'{rotor:.1f}.'
                )
        finally:
            self._watch(self._namespace)
            processes.stop()
            self._view.finder.drop(DISORDERED)
        return (
            f'In the regular chain the soliton moved at {abs(velocity(regular)):.2f} rotors/s, '
            f'and with lengths that deviate by {_DISORDER:.0%} at {abs(velocity(passage)):.2f}.'
        )

    def _ready(self, namespace: str) -> bool:
        chains = self._view.chains
        ready = namespace in chains and chains[namespace].model.named is not None
        return ready and self._view.commands(namespace).reaches('edge_command')

    async def _send(self, speed: float) -> list[Sample]:
        await self._reset()
        await self._kick(speed)
        return await self._passage()

    async def _reset(self) -> None:
        await self._view.commands(self._namespace).reset('initial')
        model = self._view.chains[self._namespace].model
        frames = model.frames
        await self._until(lambda: model.frames > frames + 1, 'a frame after the reset')

    async def _kick(self, speed: float) -> None:
        commands = self._view.commands(self._namespace)
        deadline = time.monotonic() + _CONNECTION_TIME
        while True:
            try:
                await commands.drive('kick', 'nearest', speed, (0.0, 0.0, 0.0))
                return
            except ValueError:
                if time.monotonic() > deadline:
                    raise
                await self._view.wait()

    async def _passage(self) -> list[Sample]:
        """Return the states of the soliton during its passage through the middle of the chain."""
        model = self._view.chains[self._namespace].model
        low, high = (share * (model.rotors - 1) for share in _MIDDLE)
        samples: list[Sample] = []

        def passed() -> bool:
            rotor = model.numbers.get('rotor', math.nan)
            # A passage ends only at a frame that is shown with its own state.
            old = bool(samples) and model.stamp <= samples[-1].stamp
            if math.isnan(rotor) or model.delay or old:
                return False
            if low < rotor < high:
                turn = float(model.angles[model.rotors // 2])
                zero_mode = model.numbers.get('zero_mode_rotor', math.nan)
                samples.append(Sample(model.stamp, rotor, zero_mode, turn))
                return False
            if len(samples) > 2 and abs(samples[-1].rotor - samples[0].rotor) > (high - low) / 2:
                return True
            samples.clear()
            return False

        await self._until(passed, 'a soliton to cross the middle of the chain')
        return samples

    async def _until(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + _TIMEOUT
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {_TIMEOUT:g} s for {what}')
            await self._view.wait()


class GuidedExperiment(NamedTuple):
    """Title and question of an experiment, and the method that measures the answer."""

    title: str
    question: str
    carry_out: Callable[[Laboratory], Awaitable[str]]


EXPERIMENTS = (
    GuidedExperiment(
        'A nudge',
        'No rotor in the middle can move alone. What happens if you push the edge?',
        Laboratory.nudge,
    ),
    GuidedExperiment(
        'Speed against strength',
        'If you push four times as hard, how much faster is the soliton?',
        Laboratory.speed,
    ),
    GuidedExperiment(
        'Flipper or spinner',
        'The soliton passes a rotor and comes back. Does the rotor flip back, or does it spin?',
        Laboratory.turns,
    ),
    GuidedExperiment(
        'Reflection and the edge mode',
        'What happens to the soliton at the other edge, and where is the zero mode?',
        Laboratory.reflection,
    ),
    GuidedExperiment(
        'Disorder',
        'No real chain is perfect. Does a soliton cross a chain of unequal rotors?',
        Laboratory.disorder,
    ),
)
