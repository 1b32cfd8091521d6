# SPDX-License-Identifier: Apache-2.0
"""Programs about films of a chain: markers to print, calibration, and angles into a bag."""
