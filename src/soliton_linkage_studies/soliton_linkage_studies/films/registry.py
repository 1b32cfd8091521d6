# SPDX-License-Identifier: Apache-2.0
"""Kinds of films by name: a module of this folder adds its own, and films of it are made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from soliton_linkage_studies.films.scenes import Format, Scene
from soliton_linkage_studies.registry import Registry
from soliton_linkage_studies.settings import Section

AnyScene = TypeVar('AnyScene', bound=type[Scene])


@dataclass(frozen=True)
class FilmKind:
    """How the settings of a film are read, and what makes a scene of them."""

    read: Callable[[Section], Any]
    scene: Callable[[str, Any, Format], Scene]
    """Takes the title, what was read, and the format."""


FILM_KINDS: Registry[FilmKind] = Registry('soliton_linkage_studies.films')


def film_kind(name: str, read: Callable[[Section], Any]) -> Callable[[AnyScene], AnyScene]:
    """Decorate the scene of a kind of films, whose settings a function reads."""

    def added(scene: AnyScene) -> AnyScene:
        FILM_KINDS.add(name)(FilmKind(read, scene))
        return scene

    return added
