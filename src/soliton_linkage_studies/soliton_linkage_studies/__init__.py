# SPDX-License-Identifier: Apache-2.0
"""Programs that run experiments on simulated chains, and what they share.

A study is a folder: its `program` is the command line, and the rest of it measures and draws.
What two studies need is a module of this folder; `program` and `registry` are how they are run
and found, `figure_report` how pictures, data and tables are written, `drawing` how a chain is drawn.
"""
