# SPDX-License-Identifier: Apache-2.0
"""Node that serves the ROS graph to Foxglove and Lichtblick, in place of foxglove_bridge."""
