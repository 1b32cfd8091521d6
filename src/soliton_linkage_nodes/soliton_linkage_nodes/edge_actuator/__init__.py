# SPDX-License-Identifier: Apache-2.0
"""Node that converts commands to torques and impulses, and publishes a report of each kick."""
