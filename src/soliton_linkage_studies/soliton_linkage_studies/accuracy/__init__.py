# SPDX-License-Identifier: Apache-2.0
"""Errors of estimators compared with the Cramer-Rao bound, and of the analyser with the truth.

To add an estimator of single frames, add an entry to `estimators.ESTIMATORS` and a test.
"""
