# SPDX-License-Identifier: Apache-2.0
"""What is done on the canvases of a page, with the mouse or by keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from soliton_linkage_nodes.live_view.bag_programs import BagReplay
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands


class CanvasActions:
    """Carries out actions by their names: move, nudge, seek and pause."""

    def __init__(
        self,
        finder: ChainFinder,
        commands: Callable[[str], ChainCommands],
        replay: BagReplay,
        read_only: bool,
    ) -> None:
        """`commands` gives those to the nodes of a namespace."""
        self._finder = finder
        self._commands = commands
        self._replay = replay
        self._read_only = read_only

    async def carry_out(self, name: str, arguments: Mapping[str, Any]) -> str:
        """Do what a page asks for and say what became of it; ValueError where it is refused."""
        if self._read_only:
            raise ValueError(READ_ONLY)
        namespace = str(arguments.get('chain', ''))
        if namespace not in self._finder.chains:
            raise ValueError(f'chain {namespace!r} is not there')
        commands, chain = self._commands(namespace), self._finder.chains[namespace]
        if name == 'move':
            now = chain.model.numbers.get('rotor', math.nan)
            return await commands.carry(arguments['rotor'], arguments.get('speed', 0.0), now)
        if name == 'nudge':
            edge = str(arguments.get('edge', 'nearest'))
            return commands.drive('kick', edge, arguments['speed'], (0.0, 0.0, 0.0))
        if name == 'seek':
            return await self._replay.seek(commands, float(arguments['at']))
        if name == 'pause':
            paused = bool(arguments['paused'])
            if namespace == self._replay.namespace:
                return await self._replay.pause(commands, paused)
            return await commands.pause(paused)
        raise ValueError(f'action {name!r} is not known')
