# SPDX-License-Identifier: Apache-2.0
"""Runtime of every node: parameters, diagnostics, topics, loops at a fixed rate, signals."""
