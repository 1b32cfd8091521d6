# SPDX-License-Identifier: Apache-2.0
"""To be written."""


def main() -> int:
    """Do nothing yet."""
    return 0
