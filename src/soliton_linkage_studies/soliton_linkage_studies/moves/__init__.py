# SPDX-License-Identifier: Apache-2.0
"""Walls carried to places on simulated chains, and the phonons that they wake."""
