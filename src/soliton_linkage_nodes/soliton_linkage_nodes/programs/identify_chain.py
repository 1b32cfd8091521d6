# SPDX-License-Identifier: Apache-2.0
"""Estimate the lengths of rotors, spacings and springs from bags, with standard deviations.

All bags must be recordings of the same chain. In at least one bag, a soliton must pass all rotors.
The tilt may differ between bags. The program writes the parameter file chain.yaml, the table
lengths.csv, and a report. The report also shows the noise of the angles at each bond, which is
estimated from the residuals of the fit. A bond is a pair of neighbouring rotors with its spring.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.command_line import PlainParser
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.readings import join_recordings
from soliton_linkage.identification.result import Identification
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import described_fields, quantity
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.reading import decoder, find_topic, open_bag
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.chain_identifier.parameter_file import write_parameters
from soliton_linkage_nodes.messages.chain_source import chain_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain, joint_states_from_msg
from soliton_linkage_nodes.messages.frames import EncoderMonitor
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.programs.bag_analysis import read_chain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import interrupt_on_signals
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_studies.pictures import save_report

_SPACING = described_fields(Chain)['spacing']
_GRAVITY = described_fields(Gravity)


@dataclass(frozen=True)
class IdentificationOptions:
    """Options of an identification: assumptions about the chain, and the time span to use.

    Angles alone do not determine the mean spacing, gravity and the tilts, so that these are
    options. `tolerance` is the expected relative standard deviation of lengths of one kind, for
    example of spacings. If it is None, it is estimated from the angles. Only frames from `begin`
    to `end` after the first frame are used.
    """

    spacing: float | None = quantity(
        None,
        'mean distance of neighbouring pivots; without it, gravity determines the scale',
        'm',
        _SPACING.minimum,
        _SPACING.maximum,
    )
    gravity: float = quantity(
        0.0,
        'gravity in the plane of the chain, 9.81 for an upright chain',
        'm/s^2',
        _GRAVITY['acceleration'].minimum,
        _GRAVITY['acceleration'].maximum,
    )
    tilt: tuple[float, ...] = quantity(
        (),
        'tilt of the chain at the start of each bag, positive if the last rotor is lower (0); '
        'later tilts come from the topic tilt',
        'rad',
        _GRAVITY['tilt'].minimum,
        _GRAVITY['tilt'].maximum,
    )
    tolerance: float | None = quantity(
        None,
        'relative standard deviation of the lengths of one kind (estimated from the angles)',
        '',
        1e-4,
        1.0,
    )
    begin: float = quantity(
        0.0, 'time of the first frame to use, for example after a kick by hand', 's', 0.0
    )
    end: float = quantity(math.inf, 'time of the last frame to use', 's', 0.0)


def identify_bags(
    bags: Sequence[Path],
    folder: Path,
    given: NamedChain | None = None,
    assumptions: IdentificationOptions = IdentificationOptions(),
    limits: BagLimits = DEFAULT_LIMITS,
) -> Identification:
    """Identify a chain from bags, and write chain.yaml, lengths.csv and a report.

    The reference chain is `given` or, if it is None, the chain in the first bag that contains one.
    It supplies the joint names, the mean spacing, and all values that the recordings do not
    determine. `assumptions.spacing` replaces its mean spacing. Without a reference chain, the
    joint names come from joint_states. The mean spacing is then `assumptions.spacing` or, if it is
    None, an estimate from gravity. Without gravity, the default spacing of a chain is assumed.
    """
    spacing, span = assumptions.spacing, (assumptions.begin, assumptions.end)
    tilts = assumptions.tilt or (0.0,) * len(bags)
    if len(tilts) != len(bags):
        raise ValueError(
            f'--tilt has {len(tilts)} values for {len(bags)} bags; give one for each bag, or none'
        )
    recordings = []
    reference = given
    for bag, tilt in zip(bags, tilts, strict=True):
        with open_bag(bag, limits) as reader:
            with suppress(ValueError):
                reference = reference or read_chain(reader)
            record = read_joints(reader, reference, span)
        recordings.append(record.readings(Gravity(assumptions.gravity, tilt)))
    chain = Chain() if reference is None else reference.chain
    known = not (spacing is None and reference is None)
    if spacing is not None:
        chain = dataclasses.replace(chain, spacing=spacing)
    elif not known and not assumptions.gravity:
        print(
            'identify_chain: angles do not determine the scale of a chain; the lengths assume a '
            f'mean spacing of {chain.spacing:g} m; give the true spacing with --spacing',
            file=sys.stderr,
        )
    readings = join_recordings(recordings)
    frames, rotors = readings.angles.shape
    progress, remark = ProgressLine('identifying', 1), f'{frames} frames of {rotors} rotors'
    progress.show(0, remark)
    found = identify(
        readings, chain, assumptions.tolerance, known, lambda done: progress.show(done, remark)
    )
    folder.mkdir(parents=True, exist_ok=True)
    names = ', '.join(bag.name for bag in bags)
    write_parameters(found, readings.joints, names, folder / 'chain.yaml')
    write_lengths(found, folder / 'lengths.csv')
    save_report(found, folder)
    progress.end(f'{frames} frames of {names} show a {found.chain.motion.value}; see {folder}')
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Identify the chain in the bags; exit with 1 after a failure, 130 after Ctrl-C."""
    parser = PlainParser(prog='identify_chain', description=__doc__)
    command_line.add_bags(parser)
    text = 'folder for chain.yaml, lengths.csv and the report page'
    command_line.add_output(parser, 'out/identification', text)
    parser.add_argument(
        '--chain',
        type=Path,
        metavar='FILE',
        help='parameter file with the joint names, chain.spacing, chain.mass, ...; it replaces '
        'the topic chain of the bag; lengths other than chain.spacing are ignored',
    )
    command_line.add_fields(parser, IdentificationOptions(), 'VALUE')
    command_line.add_fields(parser, BagLimits(), 'BYTES')
    options = parser.parse(arguments)
    with command_line.exit_on_failure('identify_chain'):
        interrupt_on_signals()
        given = chain_of_file(options.chain) if options.chain else None
        assumptions = command_line.fields_of(options, IdentificationOptions)
        limits = command_line.fields_of(options, BagLimits)
        print(summary(identify_bags(options.bags, options.output, given, assumptions, limits)))


_FEWEST_FRAMES = 50
"""Smallest number of frames for an identification [1]. During 50 frames at 250 Hz, a wall at 5 to
10 rotors/s passes one or two rotors."""
_MOST_FRAMES = 8000
"""Largest number of frames in a fit [1]. A fit of 8000 frames takes 10 s for 40 rotors with rigid
bars."""


def read_joints(
    reader: BagReader,
    known: NamedChain | None,
    span: tuple[float, float],
    most_frames: int = _MOST_FRAMES,
) -> JointRecord:
    """Read angles, their standard deviations, impulses and tilts from a bag.

    The joint names come from the chain `known` or, if it is None, from the bag. `span` contains
    the earliest and the latest time of the frames to use, relative to the first frame [s]. The
    result has at most `most_frames` frames. If the span has more, mainly frames in which all
    rotors rest are omitted. Raises ValueError if fewer than 50 frames can be used.
    """
    record = JointRecord(known.joint_names if known else (), most_frames)
    adders: dict[str, Callable[[Any, int], None]] = {
        interfaces.JOINT_STATE_DEVIATIONS.name: lambda message, _: record.add_deviations(
            joint_states_from_msg(message)
        ),
        interfaces.TILT.name: lambda message, received: record.add_tilt(message.data, received),
        interfaces.DELIVERED_IMPULSES.name: lambda message, _: record.add_delivered_impulses(
            message
        ),
        interfaces.DELIVERY.name: lambda message, _: record.add_delivery(message),
        interfaces.ROTOR_IMPULSES.name: record.add_command,
        interfaces.ROTOR_TORQUES.name: record.add_command,
    }
    joints = find_topic(reader, 'joint_states')
    others = [each for each in reader.topics if _name(each) in adders]
    decoders = {topic.name: decoder(topic) for topic in [joints, *others]}
    count = reader.counts[joints]
    progress = ProgressLine('reading', count)
    watch = EncoderMonitor(lambda line: print(f'identify_chain: {line}', file=sys.stderr))
    first = None
    for topic, received, serialized in reader.messages([joints, *others]):
        message = decoders[topic.name](serialized)
        if topic is not joints:
            adders[_name(topic)](message, received)
            continue
        states = joint_states_from_msg(message)
        first = states.stamp if first is None else first
        if span[0] <= (states.stamp - first) / SECOND <= span[1]:
            record.add(states)
        watch.check(states.stamp)
        progress.show(record.frames, f'{record.frames} frames')
    record.finish()
    progress.clear()
    if len(record) < _FEWEST_FRAMES:
        raise ValueError(
            f'{len(record)} of {count} frames lie between --begin {span[0]:g} s and '
            f'--end {span[1]:g} s, too few to identify a chain; omit these options'
        )
    if unused := record.frames - len(record):
        print(
            f'identify_chain: {unused} of {record.frames} frames are not used, mostly with all '
            'rotors at rest and none near impulses; to use more frames, select a part of the '
            'recording by --begin and --end',
            file=sys.stderr,
        )
    return record


def _name(topic: StoredTopic) -> str:
    return topic.name.rpartition('/')[2]


_WORST = 3
"""Number of bonds that the summary lists, those with the noisiest angles [1]."""


def write_lengths(found: Identification, path: Path) -> None:
    """Write a table of lengths [m], encoder offsets [rad] and their standard deviations."""
    chain = found.chain
    lengths = {
        'rotor_length': chain.rotor_lengths,
        'spacing': chain.spacings,
        'rest_length': chain.rest_lengths,
    }
    with path.open('w', newline='', encoding='utf-8') as file:
        table = csv.writer(file)
        table.writerow(['quantity', 'number', 'value', 'standard_deviation', 'unit'])
        for name, values in lengths.items():
            spreads = values * found.deviations[name]
            for n, (value, spread) in enumerate(zip(values, spreads, strict=True)):
                table.writerow([name, n, f'{value:.9g}', f'{spread:.3g}', 'm'])
        pairs = zip(found.offsets, found.offset_deviations, strict=True)
        for n, (value, spread) in enumerate(pairs):
            table.writerow(['offset', n, f'{value:.6g}', f'{spread:.3g}', 'rad'])


def summary(found: Identification) -> str:
    """Return a summary of the results, which has several lines."""
    deviations = ', '.join(
        f'{name} {np.median(values):.2%}' for name, values in found.deviations.items()
    )
    bonds = ', '.join(f'{n} ({found.bond_noise[n]:.2g} rad)' for n in found.worst_bonds[:_WORST])
    lines = [
        f'standard deviations (median): {deviations}',
        f'lengths of one kind have a standard deviation of {found.tolerance:.2%}',
        f'noise of the readings: {found.noise:.3g} rad from the residuals, '
        f'{found.reading_noise:.3g} rad from frame to frame; noisiest bonds: {bonds}',
        '; '.join(_forces(found)),
    ]
    if found.outliers:
        lines.append(f'{found.outliers} readings are outliers and were not used')
    if found.unused_frames:
        lines.append(
            f'{found.unused_frames} frames, mostly with all rotors at rest, were not used for '
            'masses, springs and drag'
        )
    if found.weakly_observable:
        lines.append(
            'weakly observable from the angles alone, and therefore determined by the assumption '
            f'that lengths differ by {found.tolerance:.2%}: {"; ".join(found.weakly_observable)}'
        )
    return '\n'.join([*lines, *(f'warning: {line}' for line in found.warnings)])


def _forces(found: Identification) -> Iterator[str]:
    chain = found.chain
    springs, masses = ('stiffness' in found.deviations, 'mass' in found.deviations)
    if springs:
        yield 'the soliton strains the springs'
    elif found.rigid:
        yield 'the angles fit rigid bars of constant length'
    else:
        yield 'the angles fit neither springs nor rigid bars'
    if masses:
        yield f'damping {chain.damping:.2g} +- {found.damping_deviation:.1g} N m s/rad'
        yield f'dry friction {found.friction:.2g} +- {found.friction_deviation:.1g} N m'
    missing = []
    if math.isnan(found.spacing_deviation):
        missing.append('scale of lengths')
    else:
        yield f'mean spacing {chain.spacing:.4g} m +- {found.spacing_deviation:.1%}, from gravity'
    if not masses:
        missing.append('masses')
    elif math.isnan(found.mass_deviation):
        missing.append('scale of masses')
    else:
        yield f'mean mass {chain.mass:.4g} kg +- {found.mass_deviation:.1%}, from impulses'
    if not springs:
        missing.append('stiffnesses')
    if missing:
        yield f'not determined by this recording: {", ".join(missing)}; the given values are kept'
