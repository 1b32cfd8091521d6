# SPDX-License-Identifier: Apache-2.0
"""Node that moves a soliton to a requested position."""
