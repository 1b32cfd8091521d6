# SPDX-License-Identifier: Apache-2.0
"""Errors of estimators and of the analyser, compared with the Cramer-Rao bound or the truth.

To add an estimator of single frames, add an entry to `estimators.ESTIMATORS` and a test.
"""
