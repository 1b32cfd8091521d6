# SPDX-License-Identifier: Apache-2.0
"""Programs beside the nodes: the demo, nudges and moves by hand, tools for bags."""
