# SPDX-License-Identifier: Apache-2.0
"""Measure walls on a grid of chain parameters; seeds give random deviations of the chains.

Write a table and a picture. After an interruption, the same command continues the sweep. The table
does not depend on interruptions or on the number of workers.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator

from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies import palette
from soliton_linkage_studies.figure_report import save_caption, save_pictures
from soliton_linkage_studies.figures.disorder import score_interval
from soliton_linkage_studies.measures import BLOCKED, Value
from soliton_linkage_studies.program import study_command
from soliton_linkage_studies.sweep.config import Axis, SweepStudy, read_sweep_study
from soliton_linkage_studies.sweep.table import RESUMES, fill_table
from soliton_linkage_studies.unit_cell import flipper_limit, spinner_limit

_MOST_CURVES = 5
"""A sweep with two axes is drawn as a map if both have more values than this [1]. Other sweeps
with one or two axes are drawn as curves."""
CLASS_COLOURS = {
    **{motion.value: colour for motion, colour in palette.MOTION_COLOURS.items()},
    BLOCKED: palette.DARK,
    **palette.OUTCOME_COLOURS,
}
"""Colour of each class of results, by the name of the class."""
_CLASS_LABELS = {
    BLOCKED: 'blocked: a bond may stop the wall',
    'returns': 'crosses and returns',
    'crosses': 'crosses, does not return',
    'lost': 'does not cross',
}
_NAMES = {
    'rotor_length_ratio': ('$r/a$', 'rotor length / spacing, $r/a$ [1]'),
    'rotor_length': ('$r$ [m]', 'rotor length $r$ [m]'),
    'spacing': ('$a$ [m]', 'spacing $a$ [m]'),
    'rest_angle': (r'$\bar\theta$ [rad]', r'rest angle $\bar\theta$ [rad]'),
    'number_of_rotors': ('$N$', 'number of rotors $N$ [1]'),
    'mass': ('$M$ [kg]', 'mass $M$ [kg]'),
    'stiffness': ('$k_e$ [N/m]', 'stiffness $k_e$ [N/m]'),
    'damping': ('damping [N m s/rad]', 'damping [N m s/rad]'),
    'kick': (r'kick [$a\sqrt{k_e/M}$]', r'speed of the kick, $r|\dot\phi|$ [$a\sqrt{k_e/M}$]'),
    'deviations.scale': ('scale', 'scale of the deviations [1]'),
}
"""Short and long name of each parameter, with its unit."""
_LIMITS = (
    ' For chains without deviations, flippers wobble above the solid line '
    'd = 2 r sin θ̄ / a = 1, and rotors spin above the dashed line d = d_c = 2 / sin θ̄.'
)
_SIGNS = ((r'\sqrt{k_e/M}', '√(k_e/M)'), (r'\bar\theta', 'θ̄'), (r'\dot\phi', 'φ̇'), ('$', ''))
"""Pairs of TeX notation and the plain text that replaces it."""


def sweep_figure(study: SweepStudy, rows: Sequence[dict[str, str]]) -> Figure | None:
    """Draw a sweep and return the figure, or None for more than two axes."""
    if len(study.axes) > 2:
        return None
    figure = Figure(figsize=(7.5, 5.2), layout='constrained')
    draw_sweep(figure.subplots(), study, rows)
    return figure


def draw_sweep(axes: Axes, study: SweepStudy, rows: Sequence[dict[str, str]]) -> Axes:
    """Draw the table of a sweep with one or two axes, as a map or as curves."""
    if is_map(study.axes):
        _draw_map(axes, study, rows)
    else:
        _draw_curves(axes, study, rows)
    axes.set_title(title(study), fontsize=10)
    return axes


def shares(study: SweepStudy, rows: Sequence[dict[str, str]]) -> Array:
    """Return the fraction of seeds in each class at each point [1], shape (*axes, classes)."""
    shown = np.array([row[study.measure.shown] for row in rows])
    each = np.stack([shown == name for name in study.measure.classes], axis=-1)
    return np.asarray(each.reshape(*_shape(study), -1).mean(axis=-2))


def numbers(study: SweepStudy, rows: Sequence[dict[str, str]]) -> Array:
    """Return the measured value at each point with each seed, shape (*axes, seeds).

    A value is NaN if the measurement failed or gave no number, for example if no wall crossed the
    chain and its speed was to be measured.
    """
    shown = [float(row[study.measure.shown] or 'nan') for row in rows]
    return np.array(shown).reshape(_shape(study))


def is_map(axes: Sequence[Axis]) -> bool:
    """Return whether a sweep with one or two axes is drawn as a map (see `_MOST_CURVES`)."""
    return sum(len(axis.values) > _MOST_CURVES for axis in axes) == 2


def curve_axes(axes: Sequence[Axis]) -> tuple[Axis, list[Axis]]:
    """Return the axis with the most values (the x axis of the curves), and the list of others."""
    along = max(axes, key=lambda axis: len(axis.values))
    return along, [axis for axis in axes if axis is not along]


def shows_limits(axes: Sequence[Axis]) -> bool:
    """Return whether the axes are r / a and rest angle.

    Only then can the limits between motion classes be drawn.
    """
    return {axis.name for axis in axes} == {'rotor_length_ratio', 'rest_angle'}


def class_label(name: str) -> str:
    """Return the label of a class of results."""
    return _CLASS_LABELS.get(name, name)


def _shape(study: SweepStudy) -> tuple[int, ...]:
    return (*(len(axis.values) for axis in study.axes), len(study.seeds))


def _draw_map(axes: Axes, study: SweepStudy, rows: Sequence[dict[str, str]]) -> None:
    across, up = study.axes
    edges = _edges(across), _edges(up)
    if study.measure.classes:
        classes = study.measure.classes
        colours = _blended(shares(study, rows), classes).swapaxes(0, 1)
        axes.pcolormesh(*edges, colours, rasterized=True)
        _label_classes(axes, classes, len(study.seeds))
    else:
        values = numbers(study, rows)
        counted = np.isfinite(values).sum(axis=-1)
        means = np.where(counted, np.nansum(values, axis=-1), np.nan) / np.maximum(counted, 1)
        image = axes.pcolormesh(*edges, means.T, cmap='cividis', rasterized=True)
        axes.figure.colorbar(image, ax=axes, label=study.measure.label)
    _scale_axes(axes, across, up)
    _draw_limits(axes, across, up)


def _draw_limits(axes: Axes, across: Axis, up: Axis) -> None:
    if not shows_limits((across, up)):
        return
    limits = axes.get_xlim(), axes.get_ylim()
    angles = np.linspace(*(limits[1] if up.name == 'rest_angle' else limits[0]), 400)
    angles = angles[(angles > 0) & (angles < np.pi / 2)]
    for ratios, style, label in (
        (flipper_limit(angles), '-', '$d = 1$'),
        (spinner_limit(angles), '--', r'$d = d_c = 2/\sin\bar\theta$'),
    ):
        line = (ratios, angles) if up.name == 'rest_angle' else (angles, ratios)
        effects = [withStroke(linewidth=4, foreground=palette.WHITE)]
        axes.plot(*line, style, color=palette.BLACK, label=label, path_effects=effects)
    axes.set(xlim=limits[0], ylim=limits[1])
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.28), ncols=2, frameon=False)


def _draw_curves(axes: Axes, study: SweepStudy, rows: Sequence[dict[str, str]]) -> None:
    along, families = curve_axes(study.axes)
    of_classes = bool(study.measure.classes)
    values = shares(study, rows) if of_classes else numbers(study, rows)
    values = np.moveaxis(values, study.axes.index(along), 0)
    names, curves = [''], [values]
    if families:
        names = [_value_label(families[0].name, value) for value in families[0].values]
        curves = list((values[..., :1] if of_classes else values).swapaxes(0, 1))
    elif of_classes:
        names, curves = list(study.measure.classes), list(values.T[..., None])
    colours = _curve_colours(families[0] if families else None, names)
    for number, (name, curve) in enumerate(zip(names, curves, strict=True)):
        style: Any = {
            'color': colours[number],
            'marker': palette.MARKERS[number % len(palette.MARKERS)],
        }
        style['label'] = class_label(name)
        if of_classes:
            share = curve[:, 0]
            positions = _beside(along, 0.16 * (number - (len(curves) - 1) / 2))
            bars = score_interval(share, len(study.seeds))
            axes.vlines(positions, *bars, color=style['color'], linewidth=1.5)
            axes.plot(positions, share, '-', markersize=5, clip_on=False, zorder=3, **style)
        else:
            _draw_curve(axes, along, curve, style)
    if of_classes:
        axes.set_ylim(-0.02, 1.02)
    axes.set_ylabel(_curve_label(study, bool(families)))
    _scale_axes(axes, along, None)
    spreads = (value for key, value in study.parameters.items() if key.startswith('deviations.'))
    if along.name == 'deviations.scale' and all(value == 1 for value in spreads):
        axes.set_xlabel('standard deviation, as a fraction of the parameter [1]')
    if names != ['']:
        axes.legend(frameon=False)


def _curve_colours(family: Axis | None, names: Sequence[str]) -> list[str]:
    if family is not None and _numeric(family):
        return palette.scale_colours(len(names))
    known = {**CLASS_COLOURS, **palette.MECHANICS_COLOURS}
    return [
        known.get(name, palette.COLOURS[number % len(palette.COLOURS)])
        for number, name in enumerate(names)
    ]


def _draw_curve(axes: Axes, along: Axis, curve: Array, style: Mapping[str, Any]) -> None:
    positions, colour = _positions(along), style['color']
    seen = np.isfinite(curve).any(axis=-1)
    middle, low, high = (
        np.array([quantile(one[np.isfinite(one)]) for one in curve[seen]])
        for quantile in (np.median, np.min, np.max)
    )
    axes.fill_between(positions[seen], low, high, color=colour, alpha=0.25, linewidth=0)
    if curve.shape[-1] > 1:
        axes.plot(positions, curve, '.', color=colour, markersize=3)
    axes.plot(positions[seen], middle, '-', markersize=4, **style)


def _curve_label(study: SweepStudy, families: bool) -> str:
    measure = study.measure
    if not measure.classes:
        return measure.label
    best = class_label(measure.classes[0])
    share = f'fraction of walls: {best}' if families else f'fraction, {measure.label}'
    return f'{share} [1] (bars: standard error)'


def _blended(each: Array, classes: Sequence[str]) -> Array:
    """Return the colour of the most frequent class at each point, paler if fewer seeds agree."""
    colours = np.array([to_rgb(CLASS_COLOURS[name]) for name in classes])
    share = each.max(axis=-1, keepdims=True)
    return np.asarray(share * colours[each.argmax(axis=-1)] + (1 - share))


def _label_classes(axes: Axes, classes: Sequence[str], seeds: int) -> None:
    handles = [Patch(color=CLASS_COLOURS[name], label=class_label(name)) for name in classes]
    if seeds > 1:
        half = palette.tint(CLASS_COLOURS[classes[0]], 0.5)
        handles.append(Patch(color=half, label='paler: fewer seeds'))
    place: Any = {'loc': 'upper center', 'bbox_to_anchor': (0.5, -0.12)}
    axes.add_artist(axes.legend(handles=handles, ncols=3, frameon=False, fontsize=9, **place))


def _scale_axes(axes: Axes, across: Axis, up: Axis | None) -> None:
    for axis, set_scale, parameter in (
        (axes.xaxis, axes.set_xscale, across),
        (axes.yaxis, axes.set_yscale, up),
    ):
        if parameter is None:
            continue
        axis.set_label_text(_label(parameter.name))
        if parameter.logarithmic:
            set_scale('log')
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter('{x:g}')
            axis.set_minor_formatter('')
    if not _numeric(across):
        axes.set_xticks(range(len(across.values)), [str(value) for value in across.values])


def _edges(axis: Axis) -> Array:
    values = np.array(axis.values, dtype=np.float64)
    if axis.logarithmic:
        values = np.log(values)
    middles = (values[1:] + values[:-1]) / 2
    first, last = 2 * values[0] - middles[0], 2 * values[-1] - middles[-1]
    edges = np.concatenate([[first], middles, [last]])
    highest = np.pi / 2 if axis.name == 'rest_angle' else np.inf
    return np.asarray(np.clip(np.exp(edges) if axis.logarithmic else edges, 0, highest))


def _positions(axis: Axis) -> Array:
    return np.array(axis.values if _numeric(axis) else range(len(axis.values)), dtype=np.float64)


def _beside(axis: Axis, aside: float) -> Array:
    scaled = np.log(_positions(axis)) if axis.logarithmic else _positions(axis)
    least = float(np.diff(np.sort(scaled)).min()) if len(scaled) > 1 else 1.0
    moved = scaled + aside * least
    return np.asarray(np.exp(moved) if axis.logarithmic else moved)


def _numeric(axis: Axis) -> bool:
    return not isinstance(axis.values[0], str)


def _label(name: str) -> str:
    if name in _NAMES:
        return _NAMES[name][1]
    unit = ' [1]' if name.startswith('deviations.') else ''
    return name.replace('deviations.', 'deviation of ').replace('_', ' ') + unit


def _value_label(name: str, value: Value) -> str:
    if isinstance(value, str):
        return value
    short = _NAMES.get(name, (_label(name),))[0]
    symbol, _, unit = short.partition(' [')
    return f'{symbol} = {value:g} {unit.rstrip("]")}'.rstrip()


def title(study: SweepStudy) -> str:
    """Return a title with the parameters that all points share, wrapped into lines."""
    omitted = {'time_limit', 'tolerance', *(axis.name for axis in study.axes)}
    deviating: dict[Value, list[str]] = {}
    parts = []
    for key, value in study.parameters.items():
        if key.startswith('deviations.') and key != 'deviations.scale':
            name = key.removeprefix('deviations.').replace('_', ' ')
            deviating.setdefault(value, []).append(name)
        elif key not in omitted:
            parts.append(_value_label(key, value))
    for value, names in deviating.items():
        share = '' if value == 1 and 'deviations.scale' in omitted else f' by {value:g}'
        parts.append(f'deviations{share} of {", ".join(sorted(names))}')
    return '\n'.join(textwrap.wrap('; '.join([*parts, f'{len(study.seeds)} seeds']), 95))


def sweep_caption(study: SweepStudy) -> str:
    """Return the caption of a sweep picture; it explains each symbol, colour and line."""
    label = study.measure.label
    text = f'{label[0].upper()}{label[1:]} of chains with {title(study)}. {_described(study)}'
    for sign, plain in _SIGNS:
        text = text.replace(sign, plain)
    return text


def _described(study: SweepStudy) -> str:
    classes, seeds = study.measure.classes, len(study.seeds)
    colours = ', '.join(
        f'{class_label(name)} ({palette.NAMES[CLASS_COLOURS[name]]})' for name in classes
    )
    if is_map(study.axes):
        limits = _LIMITS if shows_limits(study.axes) else ''
        if not classes:
            return f'The colour of a point is the mean of its {seeds} seeds.{limits}'
        return (
            f'The colour of a point shows its most frequent class in {seeds} seeds, paler for '
            f'fewer seeds: {colours}.{limits}'
        )
    _, families = curve_axes(study.axes)
    if not classes:
        return (
            f'Lines join the medians of {seeds} seeds (markers), dots are single seeds, and the '
            'pale band is the range from the smallest to the largest value.'
        )
    if families:
        colours = f'{class_label(classes[0])}, one curve per value of {families[0].name}'
    return (
        f'Points are fractions of {seeds} seeds: {colours}. Bars are standard errors (score '
        'interval). Curves are shifted horizontally, so that their bars do not overlap.'
    )


def _run(options: argparse.Namespace) -> str:
    study = read_sweep_study(options.config, options.quick)
    folder = options.output or Path('out/sweeps') / study.name
    path, rows = fill_table(study, folder, options.workers, options.scheduler)
    paths = [path]
    figure = sweep_figure(study, rows)
    if figure:
        paths += save_pictures(figure, folder, study.name)
        save_caption(sweep_caption(study), folder / f'{study.name}.txt')
    failed = sum(bool(row['failure']) for row in rows)
    note = f'; {failed} rows have a failure' if failed else ''
    return f'{study.rows} rows in {", ".join(map(str, paths))}{note}'


_ARGUMENTS = 'sweep', __doc__, 'a coarser grid', 'out/sweeps/NAME_OF_CONFIG', 'phase_diagram'
main = study_command(_run, RESUMES, *_ARGUMENTS, scheduler=True)
