# SPDX-License-Identifier: Apache-2.0
"""The estimators measured against their bound."""
