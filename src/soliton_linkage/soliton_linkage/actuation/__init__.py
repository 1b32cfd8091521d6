# SPDX-License-Identifier: Apache-2.0
"""Soft actuators, what they are asked for, and the torques and impulses that they give."""
