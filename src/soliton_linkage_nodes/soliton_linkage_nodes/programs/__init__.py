# SPDX-License-Identifier: Apache-2.0
"""Command-line programs: the demo, nudges and moves of a soliton, and tools for bags."""
