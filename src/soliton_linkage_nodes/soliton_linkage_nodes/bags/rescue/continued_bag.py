# SPDX-License-Identifier: Apache-2.0
"""A bag whose recorder was killed, made whole so that another recorder goes on with it."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from soliton_linkage_nodes.bags.metadata import METADATA_FILE, StoredFile
from soliton_linkage_nodes.bags.record.bag_writer import BagBegun
from soliton_linkage_nodes.bags.rescue.bag_rescue import recover_bag
from soliton_linkage_nodes.bags.storages.registry import STORAGES


def unfinished_bag(name: Path) -> Path | None:
    """The last of the bags `<name>_0`, `<name>_1`, ..., where its recorder has not finished it."""
    number = 0
    while (name.parent / f'{name.name}_{number}').exists():
        number += 1
    last = name.parent / f'{name.name}_{number - 1}'
    finished = not number or not last.is_dir() or (last / METADATA_FILE).exists()
    return None if finished else last


def take_over(bag: Path, storage: str) -> BagBegun | None:
    """Put what is intact of a bag into its first file; None where nothing is, of this storage.

    Raises OSError where that cannot be written; the bag is then as it was.
    """
    try:
        with TemporaryDirectory(prefix=f'.{bag.name}_', dir=bag.parent) as folder:
            report, whole = recover_bag(bag, Path(folder, 'whole'))
            if report.storage != storage:
                return None
            suffix = STORAGES[storage].suffix
            (recovered,) = whole.glob(f'*{suffix}')
            first = bag / f'{bag.name}_0{suffix}'
            recovered.replace(first)
    except ValueError:
        return None
    for file in report.files:
        if file != first:
            file.unlink()
    begun = report.end if report.start is None else report.start
    stored = StoredFile(first.name, report.messages, begun, report.end)
    return BagBegun(bag, stored, report.counts, report.custom_data)
