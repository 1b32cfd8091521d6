# SPDX-License-Identifier: Apache-2.0
"""What viewers without plots are told in words: phase, energies, and how the nodes do."""

from __future__ import annotations

import math
from collections.abc import Iterator

from soliton_linkage_nodes.visualisation.heard_chain import HeardChain

_LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')


def figures_of(heard: HeardChain) -> Iterator[str]:
    """Lines about a chain; of what is not known there is none."""
    told = heard.numbers
    if math.isfinite(told.get('phase', math.nan)):
        yield (
            f'phase {told["phase"]:.2f} rad, leg {told["leg"]:.0f}, {told["completed"]:.0f} cycles'
        )
    kinetic, elastic = (told.get(name, math.nan) for name in ('kinetic', 'elastic'))
    if math.isfinite(elastic):
        moving = f'kinetic {1e3 * kinetic:.3f} mJ, ' if math.isfinite(kinetic) else ''
        yield f'{moving}elastic {1e3 * elastic:.3f} mJ'
    reports = heard.reports()
    bad = [report for report in reports if report.level]
    for report in bad:
        yield f'{_LEVELS[min(report.level, 3)]} {report.node.lstrip("/")}: {report.message}'
    if reports and not bad:
        yield f'{len(reports)} nodes OK'
