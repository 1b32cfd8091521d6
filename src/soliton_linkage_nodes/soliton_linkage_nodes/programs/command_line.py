# SPDX-License-Identifier: Apache-2.0
"""The command line of a program, and its end: what is wrong is said in one line."""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rclpy.utilities import remove_ros_args

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.start import INTERRUPTED

_PLACE_IN_ROS = re.compile(r', at /\S+:\d+')


def parse_own_arguments(
    parser: PlainParser, arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Return the options that are given beside the arguments of ROS."""
    try:
        own = remove_ros_args(sys.argv[1:] if arguments is None else arguments)
    except RuntimeError as error:
        parser.error(f'wrong ROS arguments: {reason(error)}')
    return parser.parse(own)


def number(described: Quantity, kind: type[float] = float) -> Callable[[str], float]:
    """Return what reads a number of an argument and refuses what the quantity cannot be."""

    def read(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        complaint = described.complaint(value)
        if complaint:
            raise argparse.ArgumentTypeError(f'{text.strip()!r} {complaint}')
        return value

    return read


def reason(error: Exception) -> str:
    """What an error says to a person, in one line where it is one of files or of ROS."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f'{error.filename}: {error.strerror}'
    return _PLACE_IN_ROS.sub('', str(error))


@contextmanager
def exit_on_failure(program: str) -> Iterator[None]:
    """End the program with one line and 1 where it fails of what it was given, 130 on Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except (OSError, RuntimeError, ValueError) as error:
        # In a terminal a line of progress may be standing there.
        line = '\r\x1b[K' if sys.stderr.isatty() else ''
        sys.exit(f'{line}{program}: {reason(error)}')


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
