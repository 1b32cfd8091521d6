# SPDX-License-Identifier: Apache-2.0
"""Node that estimates the lengths of a chain from its joint states."""
