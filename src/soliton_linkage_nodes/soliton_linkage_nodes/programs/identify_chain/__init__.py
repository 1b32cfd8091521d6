# SPDX-License-Identifier: Apache-2.0
"""The program that turns a bag into a chain with standard deviations."""
