# SPDX-License-Identifier: Apache-2.0
"""The storages by the names that rosbag2 gives them; a new one takes a file and a line here."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from soliton_linkage_nodes.bags.storages.mcap_rescue import RescuedMcap
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.bags.storages.sqlite_rescue import RescuedSqlite
from soliton_linkage_nodes.bags.storages.sqlite_writer import SqliteWriter
from soliton_linkage_nodes.bags.storages.storage import Storage

STORAGES = {
    'mcap': Storage(
        '.mcap',
        {'none': McapWriter, 'zstd': partial(McapWriter, codec='zstd')},
        RescuedMcap,
        McapReader,
    ),
    'sqlite3': Storage('.db3', {'none': SqliteWriter}, RescuedSqlite, Sqlite3Reader),
}


def storage_of(path: Path) -> str | None:
    """Name of the storage of a file, by its suffix; None where it is no file of a bag."""
    return next((name for name, each in STORAGES.items() if each.suffix == path.suffix), None)


def compressions() -> tuple[str, ...]:
    """Names of all compressions."""
    return tuple(dict.fromkeys(name for each in STORAGES.values() for name in each.writers))


def suffixes() -> str:
    """Suffixes of all storages, for a sentence."""
    return ' or '.join(each.suffix for each in STORAGES.values())
