# SPDX-License-Identifier: Apache-2.0
"""Command-line options that programs share, and their exit with a one-line error message."""

from __future__ import annotations

import argparse
import gc
import math
import re
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.runtime.parameter_files import check_files
from soliton_linkage_nodes.runtime.process import initialise, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

Client = TypeVar('Client', bound=Node)
Group = TypeVar('Group')
_SOURCE_LOCATION = re.compile(r', at /\S+:\d+')


def parse_own_arguments(
    parser: PlainParser, arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse the options of the program itself, and ignore the arguments of ROS."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        check_files(given)
        own = remove_ros_args(given)
    except (RuntimeError, ValueError) as error:
        parser.error(f'wrong ROS arguments: {reason(error)}')
    return parser.parse(own)


def number(described: Quantity, kind: type[float] = float) -> Callable[[str], float]:
    """Return a parser for numbers that rejects values outside the range of `described`."""

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


def add_quantity(
    parser: argparse._ActionsContainer,
    name: str,
    described: Quantity,
    default: Any = None,
    kind: type[float] = float,
    **more: Any,
) -> None:
    """Add a numeric argument; `described` provides its help text, unit and allowed range."""
    unit = f' [{described.unit}]' if described.unit else ''
    shown = f' (%(default){"s" if kind is int else "g"})' if isinstance(default, kind) else ''
    text = f'{described.description}{unit}{shown}'
    parser.add_argument(name, type=number(described, kind), default=default, help=text, **more)


def reason(error: Exception) -> str:
    """Return the text of an error; file errors and ROS errors are shortened to one line."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f'{error.filename}: {error.strerror}'
    return _SOURCE_LOCATION.sub('', str(error))


@contextmanager
def exit_on_failure(program: str) -> Iterator[None]:
    """If the block fails, exit with code 1 and one line of text; after Ctrl-C, with code 130."""
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        # Clear the line of a terminal, because it may still show a progress line.
        line = '\r\x1b[K' if sys.stderr.isatty() else ''
        sys.exit(f'{line}{program}: {reason(error)}')


@contextmanager
def ros_client(program: str, create: Callable[[threading.Event], Client]) -> Iterator[Client]:
    """Initialise ROS, and yield a client, which is destroyed at the end of the block.

    `create` gets an event that SIGINT and SIGTERM set. If the block raises an error, the program
    exits immediately with code 1. If the block ends after a signal, the program exits with code
    130. The signal itself does not end the block.
    """
    stopping = stop_on_signals()
    try:
        with exit_on_failure(program):
            initialise()
            try:
                client = create(stopping)
            except ValueError as error:
                # The node whose constructor has failed is part of reference cycles.
                traceback.clear_frames(error.__traceback__)
                gc.collect()
                raise
            try:
                yield client
            finally:
                client.destroy_node()
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(INTERRUPTED)


def message_progress(title: str) -> tuple[ProgressLine, Callable[[int, int], None]]:
    """Return a progress line, and a function that updates it.

    The arguments of this function are the number of processed messages and the expected number.
    """
    progress, begun = ProgressLine(title, 0), time.monotonic()

    def show(done: int, expected: int) -> None:
        if progress.due:
            progress.total = expected
            rate = done / max(time.monotonic() - begun, 1e-3)
            progress.show(done, f'{done} messages, {rate:.0f} per second')

    return progress, show


def add_bags(parser: argparse.ArgumentParser) -> None:
    """Add a positional argument for the paths of one or more bags."""
    text = 'directory of a bag, such as bags/flipper_0'
    parser.add_argument('bags', type=Path, nargs='+', metavar='bag', help=text)


def add_output(parser: argparse.ArgumentParser, default: str, description: str) -> None:
    """Add the option --output with a default path."""
    text = f'{description} (%(default)s)'
    parser.add_argument('--output', type=Path, default=Path(default), help=text)


def add_fields(parser: argparse.ArgumentParser, defaults: Any, metavar: str) -> None:
    """Add an option for each field of a dataclass that is a `Quantity`.

    A field is a `Quantity` if the class declares it with the function `quantity` of
    `soliton_linkage.linkage.quantities`, which states its meaning, unit and range. `defaults` is
    an instance of the dataclass with the default values. The option of a field with a tuple takes
    several values. `metavar` represents a value in the help text.
    """
    for name, described in described_fields(defaults).items():
        option, default = f'--{name.replace("_", "-")}', getattr(defaults, name)
        kind = int if isinstance(default, int) else float
        several = {'nargs': '+'} if isinstance(default, tuple) else {}
        add_quantity(parser, option, described, default, kind, metavar=metavar, **several)


def fields_of(options: argparse.Namespace, kind: type[Group]) -> Group:
    """Return an instance of the dataclass `kind` from the options that `add_fields` has added."""
    values = {name: getattr(options, name) for name in described_fields(kind)}
    return kind(**{n: tuple(v) if isinstance(v, list) else v for n, v in values.items()})
