# SPDX-License-Identifier: Apache-2.0
"""Solitons carried to places on simulated chains."""
