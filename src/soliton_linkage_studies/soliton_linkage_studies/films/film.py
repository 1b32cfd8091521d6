# SPDX-License-Identifier: Apache-2.0
"""Films as a file of settings asks for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from soliton_linkage_studies.films.registry import FILM_KINDS
from soliton_linkage_studies.films.scenes import Format, Scene
from soliton_linkage_studies.settings import Section

_OF_FILMS = ('kind', 'title', 'playing_time')


@dataclass(frozen=True)
class Film:
    """What one film shows and how."""

    name: str
    kind: str
    make: Callable[[str, Any, Format], Scene]
    """Of its kind, which makes the scene."""
    title: str
    motion: Any
    """Settings of its kind."""
    shape: Format


def read_films(settings: Section) -> list[Film]:
    """Films of a file of settings, all checked; raises ValueError for what cannot be filmed."""
    settings.allow('frame_rate', 'size', 'films')
    frame_rate = settings.number('frame_rate', 1.0, 120.0)
    size = settings.numbers('size', 64, 8192)
    if len(size) != 2 or any(pixels % 2 for pixels in size):
        raise settings.complaint('size', 'must be two even numbers of pixels, as [1280, 720]')
    width, height = (int(pixels) for pixels in size)
    films = []
    for name, section in settings.section('films').sections().items():
        kind = section.text('kind', tuple(FILM_KINDS))
        frames = max(round(frame_rate * section.number('playing_time', 0.1, 3600.0)), 2)
        of_motion = {key: section.values[key] for key in section.values if key not in _OF_FILMS}
        motion = FILM_KINDS[kind].read(replace(section, values=of_motion))
        shape = Format(frames, frame_rate, width, height)
        films.append(
            Film(name, kind, FILM_KINDS[kind].scene, section.text('title'), motion, shape)
        )
    return films


def resized(film: Film, width: int, height: int, most_frames: int | None = None) -> Film:
    """Return a film of the same motion in frames of another size [pixels], and fewer of them."""
    frames = min(film.shape.frames, most_frames or film.shape.frames)
    return replace(film, shape=replace(film.shape, frames=frames, width=width, height=height))


def scene_of(film: Film) -> Scene:
    """Simulate the motion of a film and draw its first frame."""
    return film.make(film.title, film.motion, film.shape)
