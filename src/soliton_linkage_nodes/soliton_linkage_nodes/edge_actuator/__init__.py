# SPDX-License-Identifier: Apache-2.0
"""The node that turns commands into torques and impulses, and reports the last kick."""
