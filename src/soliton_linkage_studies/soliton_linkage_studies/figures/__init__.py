# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper and additional figures, each compared with theory.

To add a figure, write a module in this package that registers a function under a name in
`FIGURES`. Then add a section of this name to the settings file, and write a test.
"""

from __future__ import annotations

from collections.abc import Callable

from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.program import Registry
from soliton_linkage_studies.settings import Section

DrawFigure = Callable[[Section, bool], FigureReport]
"""Function that draws a figure from its settings, with fewer points if the flag is true."""

FIGURES: Registry[DrawFigure] = Registry()
