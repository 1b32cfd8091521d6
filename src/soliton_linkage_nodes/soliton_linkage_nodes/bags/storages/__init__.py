# SPDX-License-Identifier: Apache-2.0
"""Kinds of files that bags are made of: a new one is a file here and a line in the registry."""
