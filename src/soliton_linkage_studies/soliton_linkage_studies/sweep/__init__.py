# SPDX-License-Identifier: Apache-2.0
"""Sweeps: measurements of walls on parameter grids, in a table that survives interruptions.

To add a measure, add an entry to `soliton_linkage_studies.measures.MEASURES`, a settings file and
a test.
"""
