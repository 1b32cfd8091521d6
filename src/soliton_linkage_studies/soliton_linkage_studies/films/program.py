# SPDX-License-Identifier: Apache-2.0
"""Film the motions of chains, those of the movies of the paper, as MP4 or, without ffmpeg, GIF."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage_studies.films.files import SHRINKING, file_kind
from soliton_linkage_studies.films.film import read_films, resized
from soliton_linkage_studies.films.making import make_films
from soliton_linkage_studies.films.scenes import Format
from soliton_linkage_studies.program import chosen, run_study, study_parser
from soliton_linkage_studies.settings import load_settings

_QUICK_FRAMES = 4
"""Of a quick film, of which each shows other things."""
_QUICK_SIZE = (320, 180)
"""Of a quick film [pixels]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Film what a file of settings says; return 1 where that fails, 130 on Ctrl-C."""
    width, height = _QUICK_SIZE
    quick = f'{_QUICK_FRAMES} frames of {width} x {height} pixels a film'
    parser = study_parser('films', __doc__, quick, selective=True)
    return run_study(parser, arguments, _filmed, 'the films that were finished stay')


def _filmed(options: argparse.Namespace) -> str:
    films = read_films(load_settings(options.config))
    names = chosen([film.name for film in films], options.only)
    films = [film for film in films if film.name in names]
    if options.quick:
        films = [resized(film, *_QUICK_SIZE, _QUICK_FRAMES) for film in films]
    kind = file_kind()
    if not kind.ffmpeg:
        films = [resized(film, *_shrunk(film.shape)) for film in films]
    print(f'{len(films)} films as {kind.reason}', file=sys.stderr)
    make_films(films, options.output, kind, options.workers)
    return f'{len(films)} films are in {options.output}'


def _shrunk(shape: Format) -> tuple[int, int]:
    return shape.width // SHRINKING // 2 * 2, shape.height // SHRINKING // 2 * 2


if __name__ == '__main__':
    sys.exit(main())
