# SPDX-License-Identifier: Apache-2.0
"""Files that the study programs read and write."""

from pathlib import Path

import yaml


def written(settings: object, folder: Path) -> Path:
    path = folder / 'settings.yaml'
    path.write_text(yaml.safe_dump(settings), encoding='utf-8')
    return path


def pictures(*names: str) -> set[str]:
    return {f'{name}.{kind}' for name in names for kind in ('png', 'pdf', 'csv', 'txt')}
