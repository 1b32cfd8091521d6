# SPDX-License-Identifier: Apache-2.0
"""Study of wave packets that move walls or create them."""
