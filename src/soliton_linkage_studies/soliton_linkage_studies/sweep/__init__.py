# SPDX-License-Identifier: Apache-2.0
"""What becomes of walls over grids of parameters, as a table that survives any interruption.

A new measure is an entry of `soliton_linkage_studies.measures.MEASURES`, a file of settings and a
test.
"""
