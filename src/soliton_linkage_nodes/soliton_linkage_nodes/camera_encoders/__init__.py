# SPDX-License-Identifier: Apache-2.0
"""Angles from a camera in place of encoders: the node, and what it shares with programs."""
