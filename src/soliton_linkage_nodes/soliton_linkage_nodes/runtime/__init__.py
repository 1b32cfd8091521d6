# SPDX-License-Identifier: Apache-2.0
"""What every node stands on: parameters, diagnostics, topics, pacing, signals."""
