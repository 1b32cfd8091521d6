# SPDX-License-Identifier: Apache-2.0
"""Conversions of messages to physics types and back. No other package reads message fields."""
