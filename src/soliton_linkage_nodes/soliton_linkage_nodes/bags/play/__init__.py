# SPDX-License-Identifier: Apache-2.0
"""Components of the bag player: clock, thread and publishers."""
