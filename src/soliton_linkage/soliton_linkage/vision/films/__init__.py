# SPDX-License-Identifier: Apache-2.0
"""Films: those of files and cameras, and rendered ones of which the truth is known."""
