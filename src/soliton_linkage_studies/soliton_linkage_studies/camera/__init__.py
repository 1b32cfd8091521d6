# SPDX-License-Identifier: Apache-2.0
"""Errors of angles that are measured in rendered films, compared with the Cramer-Rao bound."""
