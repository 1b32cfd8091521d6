# SPDX-License-Identifier: Apache-2.0
"""Controls of the page beside its canvases."""
