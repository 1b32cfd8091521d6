# SPDX-License-Identifier: Apache-2.0
"""Command line, parallel tasks and exit status of the study programs."""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.workers import local_processes, process_count

Entry = TypeVar('Entry')
Key = TypeVar('Key')
Result = TypeVar('Result')

INTERRUPTED = 130
"""Exit status after Ctrl-C or SIGTERM: 128 + SIGINT, the convention of shells."""

_FAILURES = (ArithmeticError, ValueError, OSError, RuntimeError, subprocess.SubprocessError)


class Registry(dict[str, Entry]):
    """Entries by name; the modules of a package add their entries when they are imported."""

    def add(self, name: str) -> Callable[[Entry], Entry]:
        """Return a decorator that adds an entry, and raises ValueError if its name is in use."""

        def added(entry: Entry) -> Entry:
            if name in self:
                raise ValueError(f'{name!r} is registered already; choose another name')
            self[name] = entry
            return entry

        return added


def import_modules(package: str) -> None:
    """Import all modules of a package except `program`, so that they register their entries."""
    for module in pkgutil.iter_modules(importlib.import_module(package).__path__):
        if module.name != 'program':
            importlib.import_module(f'{package}.{module.name}')


def study_parser(
    name: str,
    description: str | None,
    quick: str,
    output: str = '',
    config: str = '',
    *,
    selective: bool = False,
    scheduler: bool = False,
) -> PlainParser:
    """Return the command-line parser of a study.

    Args:
        quick: Effect of `--quick`, for the help text.
        output: Description of the default output folder. An empty text means `out/<name>`.
        config: Name of the installed settings file. An empty text means the name of the study.
        selective: Whether the study has the option `--only`.
        scheduler: Whether the study has the option `--scheduler`, to run on a Dask cluster.
    """
    parser = PlainParser(
        prog=f'soliton-linkage {name}',
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    default = installed_settings(config or name)
    shown = default.name if default else 'none is installed'
    about = f'settings file, like those in config/studies [{shown}]'
    count = '?' if default else None
    parser.add_argument('config', type=Path, nargs=count, default=default, help=about)
    folder = None if output else Path('out') / name
    about = f'output folder [{output or folder}]'
    parser.add_argument('--output', type=Path, default=folder, help=about)
    parser.add_argument('--quick', action='store_true', help=f'{quick}, for a first test')
    if selective:
        about = 'names, or the parts of names before the first _ [all]'
        parser.add_argument('--only', nargs='+', default=[], metavar='NAME', help=about)
    where = parser.add_mutually_exclusive_group()
    cores, about = os.cpu_count() or 1, 'local processes [one per core]'
    where.add_argument('--workers', type=process_count, default=cores, help=about)
    if scheduler:
        where.add_argument('--scheduler', help='address of a Dask cluster, tcp://host:8786')
    return parser


def study_command(
    study: Callable[[argparse.Namespace], str], left: str, *parser: Any, **options: Any
) -> Callable[[Sequence[str] | None], int]:
    """Return the function `main` of a study; `main` runs the study and returns the exit status.

    `study_parser` receives the arguments `parser` and `options`. `run_study` receives `study`, and
    `left`, a description of the files that remain on disk after an interruption.
    """

    def main(arguments: Sequence[str] | None = None) -> int:
        return run_study(study_parser(*parser, **options), arguments, study, left)

    return main


def run_study(
    parser: PlainParser,
    arguments: Sequence[str] | None,
    study: Callable[[argparse.Namespace], str],
    left: str,
) -> int:
    """Run a study, print the text that it returns, and return the exit status.

    The status is 0 on success, 1 on failure, and 130 after Ctrl-C or SIGTERM. After an
    interruption the program prints `left`, a description of the files that remain on disk.
    """
    complete(parser)
    options = parser.parse_args(arguments)
    name = parser.prog.rpartition(' ')[2]
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        print(study(options))
    except KeyboardInterrupt:
        print(f'\n{name}: stopped; {left}', file=sys.stderr)
        return INTERRUPTED
    except _FAILURES as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    finally:
        signal.signal(signal.SIGTERM, before)
    return 0


def installed_settings(name: str) -> Path | None:
    """Return the path of an installed settings file, or None if there is none."""
    for folder in Path(__file__).resolve().parents:
        for subfolder in ('share/soliton_linkage_studies/settings', 'config/studies'):
            path = folder / subfolder / f'{name}.yaml'
            if path.is_file():
                return path
    return None


def select_names(known: Sequence[str], asked: Sequence[str], option: str = '--only') -> list[str]:
    """Return the names in `known` that `asked` selects, or all of them if `asked` is empty.

    An item of `asked` is a name, or the part of a name before its first underscore. Such a part
    selects all names that begin with it and an underscore. Raises ValueError for an unknown name.
    """
    aliases = {name: {name, name.split('_')[0]} for name in known}
    for name in asked:
        if not any(name in each for each in aliases.values()):
            names = ', '.join(known)
            raise ValueError(f'{option} {name}: unknown name; choose from {names}')
    return [name for name in known if not asked or not aliases[name].isdisjoint(asked)]


def run_parallel(
    title: str, tasks: Mapping[Key, Callable[[], Result]], workers: int
) -> dict[Key, Result]:
    """Run picklable tasks in parallel processes; return the results in the order of `tasks`."""
    progress = ProgressLine(title, len(tasks))
    begin = time.monotonic()
    done: dict[Key, Result] = {}
    with local_processes(min(workers, len(tasks))) as processes:
        futures = {processes.submit(task): key for key, task in tasks.items()}
        progress.show(0, f'0 of {len(tasks)}')
        for future in processes.finished():
            done[futures[future]] = future.result()
            left = (time.monotonic() - begin) * (len(tasks) / len(done) - 1)
            progress.show(len(done), f'{len(done)} of {len(tasks)}, {left:.0f} s left')
    progress.end(f'{title}: {len(done)} done in {time.monotonic() - begin:.0f} s')
    return {key: done[key] for key in tasks}
