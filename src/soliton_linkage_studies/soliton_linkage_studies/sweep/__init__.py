# SPDX-License-Identifier: Apache-2.0
"""Sweeps: measurements of walls on grids of chain parameters.

To add a measure, add an entry to `soliton_linkage_studies.measures.MEASURES`, a settings file and
a test.
"""
