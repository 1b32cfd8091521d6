# SPDX-License-Identifier: Apache-2.0
"""Export of a recorded run to a single HTML file that needs no server."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain

if TYPE_CHECKING:
    # Import this module for type checks only, because it imports scipy.
    from soliton_linkage.solitons.track import MeasuredWall

_BROWSER = Path(__file__).with_name('browser')
_MODULES = ('drawing.js', 'frames.js', 'chain.js', 'plots.js', 'share.js')
"""Scripts of the viewer. Each script follows the scripts that it imports."""
_MOST_VALUES = 850_000
"""Largest number of angles and energies in a file [1]. They take about 5 MB."""
_MOST_FRAMES = 6000
"""Largest number of frames in a file [1], sufficient for 100 s at 60 Hz."""
_IMPORT = re.compile(r'^import .*?;\n', re.MULTILINE | re.DOTALL)


def chain_constants(chain: Chain) -> dict[str, Any]:
    """Return the chain parameters that the page needs for drawing, as JSON values."""
    deviating = chain.deviations.rotor_length or chain.deviations.spacing
    return {
        'spacing': chain.spacing,
        'rotor_length': chain.rotor_length,
        'rest_length': chain.rest_length,
        'motion': chain.motion.value,
        'rest_lean': chain.rotor_length * math.sin(chain.rest_angle),
        'longest_rotor': float(chain.rotor_lengths.max()),
        'rotor_lengths': chain.rotor_lengths.tolist() if deviating else [],
        'pivots': np.append(0, np.cumsum(chain.spacings)).tolist() if deviating else [],
    }


def soliton_numbers(walls: Sequence[MeasuredWall]) -> list[float]:
    """Return a flat list of three numbers per soliton.

    The numbers are the position [rotor spacings], its standard deviation [m] and the charge.
    """
    return [
        value
        for wall in walls
        for value in (wall.rotor, wall.position_deviation, float(getattr(wall, 'charge', 1)))
    ]


def shared_page(
    title: str,
    chain: Chain,
    times: Array,
    angles: Array,
    solitons: Sequence[Sequence[float]],
    energies: Mapping[str, Array] | None = None,
) -> str:
    """Return an HTML page that shows T frames of N rotors. Raises ValueError if T = 0.

    `times` [s] and each of the `energies` [J] have shape (T,). `angles` [rad] have shape (T, N).
    `solitons` contains the `soliton_numbers` of each frame. Without `energies`, the page shows the
    elastic energy. If the recording is long, the page shows only every n-th frame.
    """
    if not len(times):
        raise ValueError('no frame is recorded yet; wait until joint_states are received')
    shown = energies or {'elastic': chain.elastic_energy(angles)}
    values = len(times) * (angles.shape[1] + 1 + len(shown))
    every = max(1, math.ceil(values / _MOST_VALUES), math.ceil(len(times) / _MOST_FRAMES))
    data = {
        'title': title,
        'chain': {
            **chain_constants(chain),
            'rest_lengths': chain.rest_lengths.tolist(),
            'periodic': chain.periodic,
        },
        'rotors': int(angles.shape[1]),
        'times': _packed(times[::every] - times[0]),
        'angles': _packed(angles[::every]),
        'energies': {name: _packed(series[::every]) for name, series in shown.items()},
        'solitons': [_rounded(each) for each in solitons[::every]],
    }
    script = '\n'.join(_inlined(name) for name in _MODULES)
    text = (_BROWSER / 'share.html').read_text(encoding='utf-8')
    parts = {
        '/*STYLE*/': (_BROWSER / 'live.css').read_text(encoding='utf-8'),
        '/*SCRIPT*/': script,
        # Escape "</", because JSON may contain the end tag of the script element.
        '/*DATA*/': json.dumps(data).replace('</', '<\\/'),
        '<!--TITLE-->': html.escape(title),
    }
    for mark, part in parts.items():
        text = text.replace(mark, part)
    return text


def _inlined(name: str) -> str:
    """Return a script without import and export statements, so that scripts can be joined."""
    text = (_BROWSER / name).read_text(encoding='utf-8')
    return _IMPORT.sub('', text).replace('\nexport ', '\n')


def _packed(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype='<f4').tobytes()).decode()


def _rounded(numbers: Sequence[float]) -> list[float | None]:
    return [float(f'{value:.6g}') if math.isfinite(value) else None for value in numbers]
