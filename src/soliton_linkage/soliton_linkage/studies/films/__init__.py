# SPDX-License-Identifier: Apache-2.0
"""The motions of the paper as films."""
