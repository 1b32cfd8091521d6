# SPDX-License-Identifier: Apache-2.0
"""Node that measures the angles of a chain in camera pictures, in place of encoders."""
