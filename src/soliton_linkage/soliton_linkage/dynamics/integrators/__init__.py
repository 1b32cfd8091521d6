# SPDX-License-Identifier: Apache-2.0
"""Solvers made for chains of springs, beside those of scipy; one file each, and its loops."""
