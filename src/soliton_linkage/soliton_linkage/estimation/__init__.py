# SPDX-License-Identifier: Apache-2.0
"""What frames of noisy angles show: where the chain is on its orbit, and all that follows."""
