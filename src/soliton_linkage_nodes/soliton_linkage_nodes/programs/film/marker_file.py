# SPDX-License-Identifier: Apache-2.0
"""The markers that a parameter file describes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage_nodes.programs.chain_file import chain_of_file
from soliton_linkage_nodes.runtime.parameter_files import read_sections

_PREFIX = 'markers.'


def markers_of_file(path: Path) -> MarkerSettings:
    """Markers that are printed for a parameter file, every size and place told.

    Raises ValueError for markers.* that there is not.
    """
    given: dict[str, Any] = {
        name.removeprefix(_PREFIX): value
        for held in read_sections(path).values()
        for name, value in held.items()
        if name.startswith(_PREFIX)
    }
    known = described_fields(MarkerSettings)
    for name in given:
        if name not in known:
            raise ValueError(
                f'{path}: {_PREFIX}{name} is unknown; known: {_PREFIX}{{{", ".join(known)}}}'
            )
    values: dict[str, Any] = {
        name: tuple(v) if isinstance(v, list) else v for name, v in given.items()
    }
    return MarkerLayout(chain_of_file(path).chain, MarkerSettings(**values)).as_printed
