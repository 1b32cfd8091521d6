# SPDX-License-Identifier: Apache-2.0
"""Runtime of every node: parameters, diagnostics, topics, pacing, signals."""
