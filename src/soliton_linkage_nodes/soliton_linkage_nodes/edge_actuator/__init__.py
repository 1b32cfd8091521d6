# SPDX-License-Identifier: Apache-2.0
"""Node that converts commands to torques and impulses, and reports the last kick."""
