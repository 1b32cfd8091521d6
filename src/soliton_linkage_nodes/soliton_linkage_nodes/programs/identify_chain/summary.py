# SPDX-License-Identifier: Apache-2.0
"""What was found of a chain, as a few lines and as a table."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from soliton_linkage.identification.identification import Identification

_WORST = 3
"""Bonds that are named [1]."""


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
        '; '.join(_of_forces(found)),
    ]
    if found.left_out:
        lines.append(
            f'masses, springs and drag without {found.left_out} of the frames, rather of rotors '
            'at rest'
        )
    if found.open_combinations:
        lines.append(
            f'told by angles to no better than 10 % without the {found.tolerance:.2%}: '
            f'{"; ".join(found.open_combinations)}'
        )
    return '\n'.join([*lines, *(f'warning: {line}' for line in found.warnings)])


def _of_forces(found: Identification) -> Iterator[str]:
    """What is known of masses, springs and drag, and what is not."""
    chain = found.chain
    springs, masses = ('stiffness' in found.deviations, 'mass' in found.deviations)
    if springs:
        yield 'springs give way'
    elif found.rigid:
        yield 'bonds close as those of rigid bars do'
    else:
        yield 'bonds do not close'
    if masses:
        yield f'damping {chain.damping:.2g} +- {found.damping_deviation:.1g} N m s/rad'
        yield f'dry friction {found.friction:.2g} +- {found.friction_deviation:.1g} N m'
    missing = []
    if math.isnan(found.spacing_deviation):
        missing.append('the scale of all lengths')
    else:
        yield f'mean spacing {chain.spacing:.4g} m to {found.spacing_deviation:.1%} by gravity'
    if not masses:
        missing.append('masses')
    elif math.isnan(found.mass_deviation):
        missing.append('the scale of all masses')
    else:
        yield f'mean mass {chain.mass:.4g} kg to {found.mass_deviation:.1%} by pushes'
    if not springs:
        missing.append('stiffnesses')
    if missing:
        yield f'not told: {", ".join(missing)}'
