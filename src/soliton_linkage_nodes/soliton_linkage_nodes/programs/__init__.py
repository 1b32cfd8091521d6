# SPDX-License-Identifier: Apache-2.0
"""Command-line programs: the demo experiment, tools that drive a chain, and tools for bags."""
