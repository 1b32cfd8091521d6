# SPDX-License-Identifier: Apache-2.0
"""What the recorder is made of: inlets, the writing thread, writers of each storage."""
