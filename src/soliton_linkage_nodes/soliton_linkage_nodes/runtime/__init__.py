# SPDX-License-Identifier: Apache-2.0
"""Basis of every node: parameters, diagnostics, topics, loops at a fixed rate, signals."""
