# SPDX-License-Identifier: Apache-2.0
"""Controls in the tabs of the live page."""
