# SPDX-License-Identifier: Apache-2.0
"""The door for what strangers wrote: files, packed data, texts and tables, each within limits."""
