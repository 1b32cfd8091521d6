# SPDX-License-Identifier: Apache-2.0
"""Conversions between ROS messages and physics types. Only this package accesses message fields."""
