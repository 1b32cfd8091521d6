# SPDX-License-Identifier: Apache-2.0
"""One-page validation of driven chains, with all actuators, tilts and moves."""
