# SPDX-License-Identifier: Apache-2.0
"""Conversions between messages and physics types. No other package accesses message fields."""
