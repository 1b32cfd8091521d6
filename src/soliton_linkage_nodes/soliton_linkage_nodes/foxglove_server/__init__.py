# SPDX-License-Identifier: Apache-2.0
"""The server for Foxglove and Lichtblick, where there is no foxglove_bridge."""
