# SPDX-License-Identifier: Apache-2.0
"""Node that draws the chain for ROS viewers."""
