# SPDX-License-Identifier: Apache-2.0
"""Walls in chains whose motors break reciprocity."""
