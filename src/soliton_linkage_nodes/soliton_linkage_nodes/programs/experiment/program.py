# SPDX-License-Identifier: Apache-2.0
"""Run an experiment: drive the chain, watch its solitons, record, and replay the recording.

The program starts simulator, actuator, analyser and recorder in a private ROS domain of this
machine. It writes a bag, two pictures, a page and a summary. If the parameter file has a section
filmed_experiment, the program instead renders a film of a chain with unknown lengths, identifies
the chain from the film and tracks its soliton. The page then contains the film and the results.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import shutil
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import rclpy

from soliton_linkage.command_line import PlainParser
from soliton_linkage_nodes.programs.command_line import add_output, reason
from soliton_linkage_nodes.programs.experiment.experiment import Experiment
from soliton_linkage_nodes.programs.experiment.observer import Observer
from soliton_linkage_nodes.runtime.child_processes import has_display, private_domain
from soliton_linkage_nodes.runtime.parameter_files import read_sections
from soliton_linkage_nodes.runtime.process import initialise, interrupt_on_signals, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_FILMED = 'filmed_experiment'
_WRITTEN = '.written'
"""Name of a file in the folder of results. The file lists all results, so that the next experiment
in this folder can delete them."""


def main() -> None:
    """Run the experiment that a configuration file describes."""
    options = _options()
    filmed = _named(options.configuration, _FILMED)
    if filmed:
        interrupt_on_signals()
        with _plain_end():
            _run_filmed(options, filmed)
        return
    # On a signal, set an event. An exception raised by a signal handler could be lost in a
    # callback.
    stopping = stop_on_signals()
    with private_domain():
        _run(options, stopping)


@contextmanager
def _plain_end(left: Callable[[], str] = lambda: '') -> Iterator[None]:
    """Exit with one line of text if the block fails.

    The exit code is 130 after Ctrl-C, and 1 after an error. `left` returns a sentence about an
    unfinished recording, or ''. After Ctrl-C, the text ends with this sentence.
    """
    try:
        yield
    except KeyboardInterrupt:
        print(f'Stopped.{left()}', flush=True)
        sys.exit(INTERRUPTED)
    except (RuntimeError, ValueError, OSError) as error:
        sys.exit(f'\nThe experiment failed: {reason(error)}')


def _run(options: argparse.Namespace, stopping: threading.Event) -> None:
    configuration, bag = options.configuration, Path()

    def left() -> str:
        return f' The recording so far is in {bag}.' if bag.name and bag.exists() else ''

    try:
        with _plain_end(left):
            initialise(['--ros-args', '--params-file', str(configuration)])
            with claimed(options.output) as folder:
                experiment = Experiment(configuration, folder, Observer(), stopping, options.page)
                bag = experiment.bag
                summary = experiment.run()
            lines = [conclusion(summary, folder, bag), *_suggestions(configuration)]
            print(*lines, sep='\n', flush=True)
    finally:
        rclpy.try_shutdown()


def _run_filmed(options: argparse.Namespace, given: dict[str, Any]) -> None:
    # Import this module here, because other experiments need neither scipy's fits nor OpenCV.
    from soliton_linkage_nodes.programs.experiment import filmed_experiment

    configuration = options.configuration
    with claimed(options.output) as folder:
        text = filmed_experiment.run(configuration, given, folder)
    page = folder / 'index.html'
    print(text, f'\n  {page}   film, overlay, report and track\n')
    print(*_suggestions(configuration), sep='\n', flush=True)
    if options.page and has_display():
        webbrowser.open(page.resolve().as_uri())


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Choose a folder that no other experiment uses, delete earlier results in it, and yield it.

    The folder is `folder` if no other experiment uses it. Otherwise, it is the first unused one of
    `folder`_1, `folder`_2 and so on.
    """
    candidates = (folder.with_name(f'{folder.name}_{n}') if n else folder for n in count())
    claims = ((each, _claim(each)) for each in candidates)
    chosen, claim = next((each, claim) for each, claim in claims if claim is not None)
    if chosen != folder:
        print(f'Another experiment writes to {folder}; this one writes to {chosen}.', flush=True)
    try:
        _remove_written(chosen)
        found = {path.name for path in chosen.iterdir()}
        try:
            yield chosen
        finally:
            written = sorted({path.name for path in chosen.iterdir()} - found)
            (chosen / _WRITTEN).write_text('\n'.join(written), encoding='utf-8')
    finally:
        os.close(claim)


def _remove_written(folder: Path) -> None:
    record = folder / _WRITTEN
    if not record.is_file():
        return
    for name in record.read_text(encoding='utf-8').splitlines():
        path = folder / Path(name).name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    record.unlink()


def _claim(folder: Path) -> int | None:
    """Create and lock a folder; return the file descriptor, or None if the folder is locked."""
    folder.mkdir(parents=True, exist_ok=True)
    claim = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(claim)
        return None
    return claim


def conclusion(summary: dict[str, Any], folder: Path, bag: Path) -> str:
    """Return a text about a finished experiment, with the paths of its results."""
    speed, lost = summary['speed_rotors_per_s'], summary['lost_messages']
    of_chain = f'the chain of {summary["rotors"]} rotors ({summary["motion"]})'
    first, last = (
        ', '.join(f'{site:.1f}' for site in summary[key]) or 'none'
        for key in ('first_sites', 'last_sites')
    )
    moved = f'The walls of {of_chain} were first at rotors {first}, and last at {last}.'
    if summary['crossings']:
        rate = f' at {speed:.2f} rotors/s' if speed else ''
        moved = f'A soliton crossed {of_chain} {summary["crossings"]} times{rate}.'
    return f"""
{moved}
{summary['recorded_messages']} messages were recorded, {lost or 'none'} lost.
{_agreement(summary)}

  {folder / 'kymograph.png'}   displacement of each rotor against time, and the soliton
  {folder / 'track.png'}       position and velocity of the soliton
  {folder / 'view.html'}       the run in a browser, in one file to share
  {folder / 'summary.json'}    the numbers above
  {bag}/      the bag; play it with bag_player
"""


def _agreement(summary: dict[str, Any]) -> str:
    frames, missing = summary['replayed_messages'], summary['frames_missing_in_replay']
    if missing:
        return f'{missing} frames of the live analysis are missing in the replay.'
    difference = summary['largest_replay_difference_rotors']
    if difference:
        return f'Live and replayed positions differ by up to {difference:.2g} rotor spacings.'
    return f'Live and replayed positions agree to the last digit in all {frames} frames.'


def _suggestions(configuration: Path) -> list[str]:
    others = other_scenarios(configuration)
    commands = [f'experiment {path}' for path in others]
    by_hand = 'nudge --help, to drive a chain from topics'
    if 'MAKELEVEL' in os.environ:
        made = [f'make demo SCENARIO={path.stem}' for path in others]
        commands = ['make live, to push a chain with the mouse', *made]
        by_hand = 'make shell, to drive a chain from topics'
    return ['Try next:', *(f'  {command}' for command in [*commands, by_hand])]


def other_scenarios(configuration: Path) -> list[Path]:
    """Return the parameter files of other scenarios in the folder of `configuration`.

    In such a file, the parameter `scenario` is the name of the file without the suffix .yaml.
    """
    return [
        path
        for path in sorted(configuration.parent.glob('*.yaml'))
        if path.stem != configuration.stem and _scenario(path) == path.stem
    ]


def _scenario(configuration: Path) -> object:
    try:
        given = _named(configuration, 'experiment') or _named(configuration, _FILMED)
    except (OSError, ValueError):
        return None
    return given.get('scenario')


def _named(configuration: Path, node: str) -> dict[str, Any]:
    sections = read_sections(configuration)
    return next((sections[name] for name in sections if name.split('/')[-1] == node), {})


def _options() -> argparse.Namespace:
    parser = PlainParser(prog='experiment', description=__doc__)
    parser.add_argument(
        'configuration', type=Path, help='parameter file, such as config/flipper.yaml'
    )
    add_output(parser, 'out/demo', 'folder for the results')
    parser.add_argument(
        '--page', action='store_true', help='show the chain in a browser while it runs'
    )
    options = parser.parse()
    try:
        read_sections(options.configuration)
    except (OSError, ValueError) as error:
        parser.error(f'{reason(error)}; give a parameter file such as config/flipper.yaml')
    return options
