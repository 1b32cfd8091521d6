# SPDX-License-Identifier: Apache-2.0
"""Files that the study programs read and write."""

import csv
from collections.abc import Callable
from pathlib import Path

import yaml


def written(settings: object, folder: Path) -> Path:
    path = folder / 'settings.yaml'
    path.write_text(yaml.safe_dump(settings), encoding='utf-8')
    return path


def results(
    main: Callable[[list[str]], int], name: str, settings: object, folder: Path, *options: str
) -> list[dict[str, str]]:
    """Run a study in a new folder `out`, and return the points of its only page."""
    output = folder / 'new/out'
    arguments = [str(written(settings, folder)), '--output', str(output), '--workers', '1']
    assert main([*arguments, *options]) == 0
    assert {each.name for each in output.iterdir()} == pictures(name) | {'table.md'}
    with (output / f'{name}.csv').open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def pictures(*names: str) -> set[str]:
    return {f'{name}.{kind}' for name in names for kind in ('png', 'pdf', 'csv', 'txt')}
