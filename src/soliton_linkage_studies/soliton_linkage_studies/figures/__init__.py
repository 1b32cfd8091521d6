# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper, and some of our own, beside what theory says.

A new figure is a module here that adds its function to `FIGURES`, a section of its name
in the settings, and its test.
"""

from __future__ import annotations

from collections.abc import Callable

from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.registry import Registry
from soliton_linkage_studies.settings import Section

DrawFigure = Callable[[Section, bool], FigureReport]
"""Takes the settings of a figure and whether a quick one will do."""

FIGURES: Registry[DrawFigure] = Registry('soliton_linkage_studies.figures')
