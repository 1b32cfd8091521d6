# SPDX-License-Identifier: Apache-2.0
"""Numerical experiments on simulated chains, and the modules that they share.

Each study is a subpackage whose `program` module is its command. `program` runs a study,
`figure_report` writes figures, data and tables, and `drawing` draws a chain.
"""
