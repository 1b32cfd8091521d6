# SPDX-License-Identifier: Apache-2.0
"""Identify the chain of a bag in which a soliton has passed: every length with its deviation.

Writes chain.yaml, which every node takes, lengths.csv, and a report page with the residuals of
each bond.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from soliton_linkage.identification.identification import Identification, identify
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage.progress import ProgressLine
from soliton_linkage.studies.identification.report_page import save_report
from soliton_linkage_nodes.bags.guards.limits import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.read.reading import (
    decoder,
    find_topic,
    open_bag,
    read_messages,
)
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.chain_identifier.parameter_file import write_parameters
from soliton_linkage_nodes.messages.conversions import NamedChain, joint_states_from_msg
from soliton_linkage_nodes.messages.encoder_watch import EncoderWatch
from soliton_linkage_nodes.programs.chain_file import chain_of_file
from soliton_linkage_nodes.programs.command_line import (
    ProgramParser,
    add_limits,
    limits_of,
    number,
    plain_failures,
)
from soliton_linkage_nodes.programs.linkage_bags import read_chain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import interrupt_on_signals

_MOST_FRAMES = 8000
"""Frames that are adjusted together [1]: bars of 40 rotors take some ten seconds."""
_FEWEST_FRAMES = 50
"""That are looked at [1]: a wall passes a rotor or two in them."""
_WORST = 3
"""Bonds that are named [1]."""


def identify_bag(
    bag: Path,
    folder: Path,
    given: NamedChain | None = None,
    spacing: float | None = None,
    tolerance: float | None = None,
    span: tuple[float, float] = (0.0, math.inf),
    limits: BagLimits = DEFAULT_LIMITS,
) -> Identification:
    """Write chain.yaml, lengths.csv and identification.png and .pdf; return what was found.

    Only by frames of a span of times [s] from the first frame on.
    """
    with open_bag(bag, limits) as reader:
        told = given or _told(reader)
        record = _read(reader, told)
    chain = Chain() if told is None else told.chain
    if spacing is not None:
        chain = dataclasses.replace(chain, spacing=spacing)
    elif told is None:
        print(
            'identify_chain: angles do not tell the scale of a chain; all lengths are for a mean '
            f'spacing of {chain.spacing:g} m, unless --spacing says otherwise',
            file=sys.stderr,
        )
    readings = record.readings().between(*span)
    frames, rotors = readings.angles.shape
    if frames < _FEWEST_FRAMES:
        raise ValueError(
            f'{frames} of {len(record)} frames lie between --begin {span[0]:g} s and --end '
            f'{span[1]:g} s, which is too few to identify a chain; leave them out'
        )
    progress = ProgressLine('identifying', 0)
    progress.show(0, f'{frames} frames of {rotors} rotors')
    found = identify(readings, chain, tolerance)
    folder.mkdir(parents=True, exist_ok=True)
    write_parameters(found, record.joint_names, f'{bag.name}', folder / 'chain.yaml')
    write_lengths(found, folder / 'lengths.csv')
    save_report(found, folder)
    progress.end(f'{frames} frames of {bag} show a {found.chain.motion.value}; see {folder}')
    return found


def write_lengths(found: Identification, path: Path) -> None:
    """Write each length [m] and offset [rad] with its standard deviation."""
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
    """What was found, in a few lines."""
    spreads = ', '.join(
        f'{name} {np.median(values):.2%}' for name, values in found.deviations.items()
    )
    bonds = ', '.join(f'{n} ({found.bond_noise[n]:.2g} rad)' for n in found.worst_bonds[:_WORST])
    lines = [
        f'lengths of one kind differ by {found.tolerance:.2%}; known to (median) {spreads}',
        f'noise {found.noise:.3g} rad, from frame to frame {found.reading_noise:.3g} rad; '
        f'worst bonds: {bonds}',
        _of_forces(found),
    ]
    if found.open_combinations:
        lines.append(
            f'told by angles to no better than 10 % without the {found.tolerance:.2%}: '
            f'{"; ".join(found.open_combinations)}'
        )
    return '\n'.join([*lines, *(f'warning: {line}' for line in found.warnings)])


def _of_forces(found: Identification) -> str:
    """What is known of masses and springs, and what is not."""
    if 'stiffness' not in found.deviations:
        why = 'bonds close as those of rigid bars do' if found.rigid else 'bonds do not close'
        return f'{why}; not told: the scale of all lengths together, masses and stiffnesses'
    chain = found.chain
    damping = f'damping {chain.damping:.2g} +- {found.damping_deviation:.1g} N m s/rad'
    if math.isnan(found.mass_deviation):
        return (
            f'springs give way, {damping}; not told: the scales of all lengths and of all masses'
        )
    return (
        f'springs give way, {damping}; mean mass {chain.mass:.4g} kg to '
        f'{found.mass_deviation:.1%} by pushes; not told: the scale of all lengths'
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Identify the chain of a bag; exit with 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse(arguments)
    with plain_failures('identify_chain'):
        interrupt_on_signals()
        given = chain_of_file(options.chain) if options.chain else None
        limits = limits_of(options)
        found = identify_bag(
            options.bag,
            options.output,
            given,
            options.spacing,
            options.tolerance,
            (options.begin, options.end),
            limits,
        )
        print(summary(found))


def _told(reader: Reader) -> NamedChain | None:
    try:
        return read_chain(reader)
    except ValueError:
        return None


def _read(reader: Reader, told: NamedChain | None) -> JointRecord:
    """Angles, their standard deviations, and pushes."""
    joints = find_topic(reader, 'joint_states')
    others = {
        topic.name: topic
        for topic in (
            interfaces.JOINT_STATE_DEVIATIONS,
            interfaces.ROTOR_IMPULSES,
            interfaces.ROTOR_TORQUES,
        )
    }
    wanted = [
        joints,
        *(each for each in reader.connections if each.topic.rpartition('/')[2] in others),
    ]
    decoders = {connection.topic: decoder(connection) for connection in wanted}
    progress = ProgressLine('reading', joints.msgcount)
    watch = EncoderWatch(lambda line: print(f'identify_chain: {line}', file=sys.stderr))
    record: JointRecord | None = None
    for connection, received, serialized in read_messages(reader, wanted):
        message = decoders[connection.topic](serialized)
        if connection is joints:
            states = joint_states_from_msg(message)
            if record is None:
                record = JointRecord(told.joint_names if told else states.name, _MOST_FRAMES)
            record.add(states)
            watch.look(states.stamp, states.position)
            progress.show(record.frames, f'{record.frames} frames')
        elif record is None:
            continue
        elif connection.topic.endswith(interfaces.JOINT_STATE_DEVIATIONS.name):
            record.add_deviations(joint_states_from_msg(message))
        else:
            record.add_push(message, received)
    if record is None or not len(record):
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic joint_states')
    progress.clear()
    if record.thinned > 1:
        print(
            f'identify_chain: of {record.frames} frames one in {record.thinned} is used',
            file=sys.stderr,
        )
    return record


def _parser() -> ProgramParser:
    parser = ProgramParser(prog='identify_chain', description=__doc__)
    parser.add_argument('bag', type=Path, help='directory of a bag, as bags/flipper_0')
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out/identification'),
        help='folder for chain.yaml, lengths.csv and the report page (%(default)s)',
    )
    parser.add_argument(
        '--chain',
        type=Path,
        metavar='FILE',
        help='parameter file with the names of the joints, chain.spacing, chain.mass, ..., in '
        "place of the bag's topic chain; its other lengths do not count",
    )
    parser.add_argument(
        '--spacing',
        type=number(described_fields(Chain)['spacing']),
        metavar='METRES',
        help='mean distance of neighbouring pivots [m], which angles do not tell',
    )
    parser.add_argument(
        '--tolerance',
        type=number(Quantity('tolerance', '', 1e-4, 1.0)),
        metavar='FRACTION',
        help='standard deviation by which lengths of one kind differ from each other [1] (learnt '
        'from the angles)',
    )
    time = Quantity('time', 's', 0.0)
    parser.add_argument(
        '--begin',
        type=number(time),
        default=0.0,
        metavar='SECONDS',
        help='time from the first frame on from which frames count, as after a kick by hand [s] '
        '(%(default)s)',
    )
    parser.add_argument(
        '--end',
        type=number(time),
        default=math.inf,
        metavar='SECONDS',
        help='time until which frames count [s] (%(default)s)',
    )
    add_limits(parser)
    return parser
