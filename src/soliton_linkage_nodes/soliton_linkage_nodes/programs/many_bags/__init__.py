# SPDX-License-Identifier: Apache-2.0
"""Many bags analysed side by side, into one table."""
