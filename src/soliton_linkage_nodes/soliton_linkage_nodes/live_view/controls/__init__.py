# SPDX-License-Identifier: Apache-2.0
"""What a person can do on the page, beside what the canvases take."""
