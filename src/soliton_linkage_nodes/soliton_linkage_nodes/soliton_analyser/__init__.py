# SPDX-License-Identifier: Apache-2.0
"""Node that estimates the positions of the solitons from joint states."""
