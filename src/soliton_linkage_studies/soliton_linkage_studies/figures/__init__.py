# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper, and some of our own, beside what theory says.

A new figure is a module here that adds its function to `registry.FIGURES`, a section of its name
in the settings, and its test.
"""
