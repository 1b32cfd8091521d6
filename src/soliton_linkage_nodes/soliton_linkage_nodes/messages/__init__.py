# SPDX-License-Identifier: Apache-2.0
"""Conversions between messages and physics types.

Only this package reads and writes the fields of messages.
"""
