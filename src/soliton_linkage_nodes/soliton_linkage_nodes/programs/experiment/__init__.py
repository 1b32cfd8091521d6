# SPDX-License-Identifier: Apache-2.0
"""Demo: run an experiment with all nodes, and draw the recorded motion."""
