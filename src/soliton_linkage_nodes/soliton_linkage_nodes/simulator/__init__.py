# SPDX-License-Identifier: Apache-2.0
"""Node that replaces a real chain and publishes its joint states."""
