# SPDX-License-Identifier: Apache-2.0
"""Bags, of any topics: recording, playing, reading and rescue. Knows no linkage."""
