# SPDX-License-Identifier: Apache-2.0
"""Measure angles in rendered films, and compare the angle errors with the Cramer-Rao bound.

Write a table as Markdown. After an interruption, the same command continues with the next clip.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soliton_linkage import vision
from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies.camera.renderer import FilmSettings
from soliton_linkage_studies.camera.runs import FIGURES, FilmedTask
from soliton_linkage_studies.program import study_command
from soliton_linkage_studies.settings import Section, load_settings
from soliton_linkage_studies.sweep.table import RESUMES, fill_table, fingerprint, markdown_table

COLUMNS = (
    *('pictures', 'hidden', 'swapped', 'turns lost', 'bound of the pixels [mrad]'),
    *('noise [mrad]', 'stated [mrad]', 'noise over stated', 'bias over noise', 'a picture [ms]'),
)


@dataclass(frozen=True)
class FilmStudy:
    """Study of films. A film consists of several clips, and each clip starts with a kick."""

    films: Mapping[str, FilmedTask]
    clips: int
    name: str = 'films'

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table, which has one row per clip."""
        return ('row', 'film', 'clip', *FIGURES)

    @property
    def rows(self) -> int:
        """Number of clips."""
        return len(self.films) * self.clips

    def cells(self, row: int) -> list[str]:
        """Render and measure the clip of a row; rows are sorted by clip, then by film."""
        clip, film = divmod(row, len(self.films))
        name, task = list(self.films.items())[film]
        stretch = float(np.random.default_rng(row).uniform(0.7, 1.3))
        light = replace(task.settings, seed=row)
        run = replace(task, kick=stretch * task.kick, settings=light)()
        return [str(row), name, str(clip), *(f'{figure:.9g}' for figure in run.figures)]

    def described(self) -> dict[str, Any]:
        """Return all settings that determine the rows, and a hash of the package `vision`."""
        return {
            'films': {name: str(task) for name, task in self.films.items()},
            'clips': self.clips,
            'vision': fingerprint(vision),
        }


def read_film_study(settings: Section, quick: bool) -> FilmStudy:
    """Read the settings; raise ValueError if they are invalid."""
    settings.check_keys('frames', 'clip', 'kicks', 'films', 'chains')
    frames = settings.whole_number('frames', 20, 1_000_000)
    clip = min(settings.whole_number('clip', 20, 100_000), frames)
    clips = 1 if quick else -(-frames // clip)
    of_clip = min(clip, 120) if quick else clip
    kicks = settings.section('kicks')
    films = {}
    for title, film in settings.sections('films').items():
        film.check_keys('noise', 'quality', 'h264')
        light = FilmSettings(
            noise=film.number('noise', 0.0, 50.0), quality=film.whole_number('quality', 0, 100)
        )
        for name, chain in settings.chains().items():
            kick, h264 = kicks.number(name, 1e-6, 10.0), film.whole_number('h264', 0, 51)
            films[f'{name}, {title}'] = FilmedTask(chain, kick, of_clip, light, h264)
    return FilmStudy(films, clips, 'films_quick' if quick else 'films')


def table_of(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a Markdown table with one row per film, computed from the rows of all clips."""
    lines = []
    for name in dict.fromkeys(row['film'] for row in rows):
        clips = [row for row in rows if row['film'] == name]
        figures = {key: np.array([float(clip[key]) for clip in clips]) for key in FIGURES}
        lines.append([name, *_row(figures)])
    return markdown_table(['film', *COLUMNS], lines)


def _row(figures: Mapping[str, Array]) -> list[str]:
    root_mean_squares = ('noise', 'stated', 'normalised')
    noise, stated, normalised = (np.sqrt(np.mean(figures[key] ** 2)) for key in root_mean_squares)
    total = {key: figures[key].sum() for key in figures}
    return [
        f'{total["pictures"]:.0f}',
        f'{total["hidden"] / total["angles"]:.2%}',
        f'{total["swapped"]:.0f}',
        f'{total["turns_lost"]:.0f}',
        f'{1e3 * figures["bound"].mean():.3f}',
        f'{1e3 * noise:.3f}',
        f'{1e3 * stated:.3f}',
        f'{normalised:.2f}',
        f'{figures["bias"].mean() / noise:+.3f}',
        f'{1e3 * figures["busy"].mean():.1f}',
    ]


def _made(options: argparse.Namespace) -> str:
    study = read_film_study(load_settings(options.config), options.quick)
    _, rows = fill_table(study, options.output, options.workers)
    text = table_of(rows)
    (options.output / 'table.md').write_text(text, encoding='utf-8')
    return f'{text}\nthe table is in {options.output}'


main = study_command(_made, RESUMES, 'camera', __doc__, 'one clip of two seconds per film')
