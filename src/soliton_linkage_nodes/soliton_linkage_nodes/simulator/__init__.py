# SPDX-License-Identifier: Apache-2.0
"""Node that simulates a chain, in place of a real chain, and publishes its joint states."""
