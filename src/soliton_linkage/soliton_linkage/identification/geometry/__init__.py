# SPDX-License-Identifier: Apache-2.0
"""Lengths and offsets that close the bonds of all frames, without forces."""
