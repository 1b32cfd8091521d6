# SPDX-License-Identifier: Apache-2.0
"""The node that carries a soliton to a place on demand."""
