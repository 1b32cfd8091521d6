# SPDX-License-Identifier: Apache-2.0
"""The figures by name: a module of this folder adds its own, and its settings draw it."""

from __future__ import annotations

from collections.abc import Callable

from soliton_linkage_studies.plates import Plate
from soliton_linkage_studies.registry import Registry
from soliton_linkage_studies.settings import Section

DrawFigure = Callable[[Section, bool], Plate]
"""Takes the settings of a figure and whether a quick one will do."""

FIGURES: Registry[DrawFigure] = Registry('soliton_linkage_studies.figures')
