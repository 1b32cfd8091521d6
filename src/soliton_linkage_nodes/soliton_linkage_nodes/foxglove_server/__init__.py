# SPDX-License-Identifier: Apache-2.0
"""Node that serves a ROS graph to Foxglove and Lichtblick without foxglove_bridge."""
