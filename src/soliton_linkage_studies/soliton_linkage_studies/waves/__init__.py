# SPDX-License-Identifier: Apache-2.0
"""Wave packets that move walls and create them."""
