# SPDX-License-Identifier: Apache-2.0
"""State that all pages share: the chains, the recorder and the player."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node

from soliton_linkage_nodes.live_view.bag_catalogue import BagCatalogue
from soliton_linkage_nodes.live_view.bag_programs import BagRecording, BagReplay
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.status import status_of

ALL = '*'
"""Name that a page uses instead of a namespace to show all chains side by side."""
_STATUS_PERIOD = 0.25
"""Time between two updates of the status [s]. Nodes report once per second."""
_MOST_FAILURES = 3
"""Largest number of failures of the recorder and the player that the page shows [1]."""


class View:
    """Present state of all chains. The pages of all browsers share one instance."""

    def __init__(
        self, node: Node, finder: ChainFinder, folders: Sequence[Path], logs: Path, read_only: bool
    ) -> None:
        self.finder = finder
        self.read_only = read_only
        self.logs = logs
        self.catalogue = BagCatalogue(folders)
        folder = folders[0] if folders else None
        self.recording = BagRecording(folder, finder, self.commands)
        self.replay = BagReplay(self.catalogue, logs, finder, self.commands)
        self.status = ''
        self.sent = 0
        """Total number of frames sent to all browsers."""
        self.reasons: dict[str, dict[str, str]] = {}
        """Reason why each control is disabled, by namespace and control; '' if it is enabled."""
        self._node = node
        self._failures: list[str] = []
        self._packed: dict[tuple[int, int, int], bytes] = {}
        self._commands: dict[str, ChainCommands] = {}
        self._updated_at = 0.0
        self._updated = asyncio.Event()

    @property
    def chains(self) -> Mapping[str, ChainTopics]:
        """Chains by namespace. Their order defines the indices of the chains on the page."""
        return self.finder.chains

    def commands(self, namespace: str) -> ChainCommands:
        """Return the object that sends commands to the nodes in a namespace."""
        if namespace not in self._commands:
            self._commands[namespace] = ChainCommands(
                self._node, namespace, self.read_only, self.finder
            )
        return self._commands[namespace]

    @property
    def versions(self) -> list[int]:
        """Version numbers of the played bag and of each chain.

        The list changes whenever `descriptions` changes.
        """
        return [self.replay.played, *(c.model.version for c in self.chains.values())]

    def descriptions(self) -> dict[str, Any]:
        """Return the parameters of each chain and the soliton trajectory of the played bag."""
        chains = [
            {'name': namespace, **chain.model.description()}
            for namespace, chain in self.chains.items()
        ]
        return {'chains': chains, 'track': self.replay.track.points}

    def shared(self, namespace: str) -> str:
        """Return an HTML page with the last minute of a chain.

        Raises ValueError if the chain has no frames.
        """
        if namespace not in self.chains:
            raise ValueError('select another chain; no node publishes joint_states of this one')
        title = f'Soliton chain {namespace.strip("/")}'.strip()
        return self.chains[namespace].model.shared(
            f'{title}, {time.strftime("%Y-%m-%d %H:%M:%S")}'
        )

    def packed(self, index: int, chain: ChainTopics, first: int, last: int) -> bytes:
        """Return the result of `ChainModel.packed` for the state of a chain.

        The result is stored until the next `update`, because several pages may request it.
        """
        window = index, first, last
        if window not in self._packed:
            self._packed[window] = chain.model.packed(*window)
        return self._packed[window]

    async def wait(self) -> None:
        """Wait until the next call of `update` has ended."""
        await self._updated.wait()

    def update(self, cameras: Collection[str]) -> None:
        """Process the newest messages. `cameras` are the namespaces whose pictures are shown."""
        self._packed.clear()
        self.finder.update()
        for namespace, chain in self.chains.items():
            chain.camera.show(namespace in cameras)
            commands = self.commands(namespace)
            report = self.finder.reports.get(f'{namespace}soliton_steering')
            if report is not None:
                commands.follow(report[0], report[1].figures)
            move = commands.move
            if move.foreign:
                move.rotor = chain.model.numbers.get('rotor', math.nan)
            chain.model.goal = move.goal if move.under_way else math.nan
            if namespace == self.replay.namespace:
                at = self.replay.position
                chain.model.bag_time = math.nan if at is None else at
        now = time.monotonic()
        if now - self._updated_at >= _STATUS_PERIOD:
            self._updated_at = now
            self._update_status()
        updated, self._updated = self._updated, asyncio.Event()
        updated.set()

    def close(self) -> None:
        """Stop the recorder and the player, and destroy the clients."""
        self.recording.close()
        self.replay.close()
        for commands in self._commands.values():
            commands.close()

    def _update_status(self) -> None:
        self._failures += filter(None, (self.recording.poll(), self.replay.poll()))
        del self._failures[:-_MOST_FAILURES]
        chains = [
            status_of(self.finder, chain, self.commands(namespace))
            for namespace, chain in self.chains.items()
        ]
        self.reasons = {each['name']: each['reasons'] for each in chains}
        status = {
            'chains': chains,
            'replay': self.replay.status(),
            'recorder': self.recording.status(),
            'failures': self._failures,
        }
        self.status = json.dumps({'status': status})
