# SPDX-License-Identifier: Apache-2.0
"""Several walls of a chain: which of them a frame shows, who is who, what became of them."""
