# SPDX-License-Identifier: Apache-2.0
"""Record, play, read and recover bags of any topics, independently of the linkage."""
