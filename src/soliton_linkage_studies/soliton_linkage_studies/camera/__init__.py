# SPDX-License-Identifier: Apache-2.0
"""Accuracy of camera angle measurements in rendered films, and the Cramer-Rao bound."""
