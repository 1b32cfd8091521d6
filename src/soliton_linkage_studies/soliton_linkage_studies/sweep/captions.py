# SPDX-License-Identifier: Apache-2.0
"""What the picture of a sweep shows, in words."""

from __future__ import annotations

from soliton_linkage_studies.palette import NAMES
from soliton_linkage_studies.sweep.config import SweepStudy
from soliton_linkage_studies.sweep.pictures import (
    CLASS_COLOURS,
    curve_axes,
    is_map,
    said_of,
    shows_limits,
    title,
)

_LIMITS = (
    ' The solid line is d = 2 r sin θ̄ / a = 1, beyond which flippers wobble, the dashed one '
    'd = d_c = 2 / sin θ̄, beyond which walls spin, in chains without deviations.'
)
_SIGNS = ((r'\sqrt{k_e/M}', '√(k_e/M)'), (r'\bar\theta', 'θ̄'), (r'\dot\phi', 'φ̇'), ('$', ''))
"""Signs of mathematics as pictures are written with them, and plainly."""


def sweep_caption(study: SweepStudy) -> str:
    """Say what the picture of a sweep shows: each symbol, colour and line of it."""
    label = study.measure.label
    text = f'{label[0].upper()}{label[1:]}, of chains with {title(study)}. {_said(study)}'
    for sign, plain in _SIGNS:
        text = text.replace(sign, plain)
    return text


def _said(study: SweepStudy) -> str:
    classes, seeds = study.measure.classes, len(study.seeds)
    colours = ', '.join(f'{said_of(name)} ({NAMES[CLASS_COLOURS[name]]})' for name in classes)
    if is_map(study.axes):
        limits = _LIMITS if shows_limits(study.axes) else ''
        if not classes:
            return f'Each point has the colour of the mean of its {seeds} seeds.{limits}'
        return (
            f'Each point has the colour of the class of most of its {seeds} seeds, the paler the '
            f'fewer they are: {colours}.{limits}'
        )
    _, families = curve_axes(study.axes)
    if not classes:
        return (
            f'Lines join the medians of {seeds} seeds (markers), dots are the seeds, and a pale '
            'band reaches from the least to the largest of them.'
        )
    shown = (
        f'{said_of(classes[0])}, a curve for each of the {families[0].name}'
        if families
        else colours
    )
    return (
        f'Points are shares of {seeds} seeds: {shown}. Bars are their standard errors (score '
        'interval); curves stand a bit aside of each other, so that their bars can be told apart.'
    )
