# SPDX-License-Identifier: Apache-2.0
"""The nodes of the suite in one process."""
