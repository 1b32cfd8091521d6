# SPDX-License-Identifier: Apache-2.0
"""Errors of estimators and of the analyser, compared with the Cramer-Rao bound or the truth.

To add an estimator that uses one frame, register it in `estimators.ESTIMATORS` and write a test.
"""
