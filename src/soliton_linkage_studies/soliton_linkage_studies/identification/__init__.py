# SPDX-License-Identifier: Apache-2.0
"""What is drawn of chains that were identified."""
