# SPDX-License-Identifier: Apache-2.0
"""The estimators of a wall measured against the bound of Cramer and Rao.

A new estimator of one frame is an entry of `estimators.ESTIMATORS` with its test.
"""
