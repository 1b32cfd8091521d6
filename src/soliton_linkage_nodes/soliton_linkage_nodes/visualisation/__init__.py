# SPDX-License-Identifier: Apache-2.0
"""The visualisation: the chain as the viewers of ROS draw it."""
