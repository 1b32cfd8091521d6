# SPDX-License-Identifier: Apache-2.0
"""The answers of the lesson are measured on the chain."""

import asyncio
import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from soliton_linkage_nodes.live_view.lesson import Laboratory

ROTORS, PERIOD = 41, 0.02


class Chain:
    """View of a chain whose soliton runs between the edges, as fast as it was nudged.

    Some frames have no state. Some have an older state, because the analyser lags.
    """

    def __init__(self, turn_back: float) -> None:
        numbers = {'rotor': math.nan, 'zero_mode_rotor': 0.0, 'wall_energy': 1e-3}
        self.model = SimpleNamespace(
            rotors=ROTORS, numbers=numbers, stamp=0.0, frames=0, angles=np.zeros(ROTORS), delay=0.0
        )
        self.chains = {'/': SimpleNamespace(model=self.model)}
        self._speed, self._way, self._turn_back = 0.0, 0.0, turn_back
        self.rejections = 0

    def commands(self, _: str) -> Any:
        return self

    async def reset(self, _: str) -> None:
        self._speed, self._way = 0.0, 0.0

    async def drive(self, _kind: str, _edge: str, speed: float, _times: Any) -> None:
        self.rejections -= 1
        if self.rejections >= 0:
            raise ValueError('nothing subscribes to rotor_impulses')
        self._speed = speed / 2

    async def wait(self) -> None:
        model = self.model
        model.frames += 1
        model.stamp += PERIOD
        self._way += self._speed * PERIOD
        legs, part = divmod(self._way / (ROTORS - 1), 1)
        rotor = (ROTORS - 1) * (part if legs % 2 == 0 else 1 - part)
        model.numbers = {'rotor': rotor, 'zero_mode_rotor': rotor, 'wall_energy': 1e-3}
        if model.frames % 7 == 0:
            model.numbers = {}
        passages = (self._way + (ROTORS - 1) / 2) // (ROTORS - 1)
        model.angles[ROTORS // 2] = 2.0 * (passages == 1) + self._turn_back * (passages >= 2)
        model.delay = 3.0 if 12 < rotor < 14 or 26 < rotor < 28 else 0.0
        if model.delay:
            model.angles[ROTORS // 2] = 10.0 * legs
        await asyncio.sleep(0)


def measured(name: str, turn_back: float = 0.0) -> str:
    view: Any = Chain(turn_back)
    return asyncio.run(getattr(Laboratory(view, '/', lambda _: None), name)())


def test_the_speed_is_the_slope_of_the_track():
    assert measured('nudge').startswith('A soliton crossed the chain at 5.00 rotors/s with')


def test_the_speeds_of_three_nudges_are_compared():
    answer = measured('speed')
    assert '5 rad/s: 2.50 rotors/s, 10 rad/s: 5.00 rotors/s, 20 rad/s: 10.00' in answer
    assert answer.endswith('With 4 times the nudge the soliton is 4.00 times as fast.')


def test_a_rotor_flips_or_spins():
    for turn_back, kind in [(0.0, 'flips back'), (2 * math.pi, 'spins')]:
        assert measured('turns', turn_back).endswith(f'It {kind}.')


def test_the_velocity_changes_its_sign_at_the_edge():
    answer = measured('reflection')
    assert '+5.00 rotors/s before the edge and -5.00 rotors/s after it' in answer


def test_a_kick_is_repeated_until_the_actuator_is_connected():
    view: Any = Chain(0.0)
    view.rejections = 3
    answer = asyncio.run(Laboratory(view, '/', lambda _: None).nudge())
    assert answer.startswith('A soliton crossed the chain at 5.00 rotors/s with')
    assert view.rejections < 0
