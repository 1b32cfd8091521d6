# SPDX-License-Identifier: Apache-2.0
"""The storages by the names that rosbag2 gives them.

A new one of the suite takes a file and a line here; another package offers its own as an entry
point of the group `soliton_linkage_nodes.storages`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path

from soliton_linkage_nodes.bags.storages.mcap_reader import IndexedMcap
from soliton_linkage_nodes.bags.storages.mcap_rescue import RescuedMcap
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.bags.storages.sqlite_reader import StoredSqlite
from soliton_linkage_nodes.bags.storages.sqlite_rescue import RescuedSqlite
from soliton_linkage_nodes.bags.storages.sqlite_writer import SqliteWriter
from soliton_linkage_nodes.bags.storages.storage import Storage


def offered_elsewhere() -> dict[str, Storage]:
    """Storages that other packages offer."""
    return {
        each.name: each.load() for each in entry_points(group='soliton_linkage_nodes.storages')
    }


STORAGES: dict[str, Storage] = {
    'mcap': Storage(
        '.mcap',
        {'none': McapWriter, 'zstd': partial(McapWriter, codec='zstd')},
        RescuedMcap,
        IndexedMcap,
    ),
    'sqlite3': Storage('.db3', {'none': SqliteWriter}, RescuedSqlite, StoredSqlite),
    **offered_elsewhere(),
}


def storage_of(path: Path) -> str | None:
    """Name of the storage of a file, by its suffix; None where it is no file of a bag."""
    return next((name for name, each in STORAGES.items() if each.suffix == path.suffix), None)


def compressions() -> tuple[str, ...]:
    """Names of all compressions."""
    return tuple(dict.fromkeys(name for each in STORAGES.values() for name in each.writers))


class NamesNow(Collection[str]):
    """Names as they are whenever somebody looks: a storage may be added at any time."""

    def __init__(self, look_up: Callable[[], Collection[str]]) -> None:
        """Look them up by a function."""
        self._look_up = look_up

    def __contains__(self, name: object) -> bool:
        """Whether a name is one of them now."""
        return name in self._look_up()

    def __iter__(self) -> Iterator[str]:
        """Those of now."""
        return iter(self._look_up())

    def __len__(self) -> int:
        """How many there are now."""
        return len(self._look_up())


def suffixes() -> str:
    """Suffixes of all storages, for a sentence."""
    return ' or '.join(each.suffix for each in STORAGES.values())
