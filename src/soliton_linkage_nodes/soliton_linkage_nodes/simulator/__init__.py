# SPDX-License-Identifier: Apache-2.0
"""Node that simulates a chain instead of a real one, and publishes the joint states."""
