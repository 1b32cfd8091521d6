# SPDX-License-Identifier: Apache-2.0
"""Numerical experiments on simulated chains, and the modules that they share.

Each study is a subpackage whose module `program` is the command. Of the shared modules, `program`
contains the command line of all studies, `figure_report` writes figures, data and tables, and
`drawing` draws a chain.
"""
