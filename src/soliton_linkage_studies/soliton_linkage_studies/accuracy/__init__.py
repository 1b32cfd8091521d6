# SPDX-License-Identifier: Apache-2.0
"""The estimators of a wall measured against the bound, and what the analyser states against truth.

A new estimator of one frame is an entry of `estimators.ESTIMATORS` with its test.
"""
