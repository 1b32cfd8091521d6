# SPDX-License-Identifier: Apache-2.0
"""What the analyser states, checked in cells drawn at random and in named hard cases.

`soliton-linkage accuracy --only cells` runs all, `--cells 3 17 outliers` some of them, `--frames`
fewer frames of each, `--seed` those of another day, and `--against OTHER.csv` says which are worse
than in an earlier table.
"""
