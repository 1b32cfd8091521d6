# SPDX-License-Identifier: Apache-2.0
"""The demo: an experiment from the first node to the pictures."""
