# SPDX-License-Identifier: Apache-2.0
"""Options of programs that read bags: what the files of a stranger may ask for."""

from __future__ import annotations

import argparse
import dataclasses

from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage_nodes.bags.guards.limits import BagLimits
from soliton_linkage_nodes.programs.command_line import number


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add an option for each limit, with its value as default."""
    for name, described in described_fields(BagLimits).items():
        parser.add_argument(
            f'--{name.replace("_", "-")}',
            type=number(described, int),
            metavar='BYTES',
            default=getattr(BagLimits(), name),
            help=f'{described.description} [B] (%(default)s)',
        )


def limits_of(options: argparse.Namespace) -> BagLimits:
    """Limits that were given."""
    names = [each.name for each in dataclasses.fields(BagLimits)]
    return BagLimits(**{name: getattr(options, name) for name in names})
