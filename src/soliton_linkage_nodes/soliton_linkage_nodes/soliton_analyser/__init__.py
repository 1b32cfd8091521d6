# SPDX-License-Identifier: Apache-2.0
"""The node that says where the soliton is, and what live and offline analysis share."""
