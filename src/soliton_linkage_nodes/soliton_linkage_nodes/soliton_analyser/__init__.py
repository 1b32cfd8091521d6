# SPDX-License-Identifier: Apache-2.0
"""Node that estimates the position of the soliton from joint states."""
