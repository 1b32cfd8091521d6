# SPDX-License-Identifier: Apache-2.0
"""The node that shows chains in a browser and takes what is done there, and its page."""
