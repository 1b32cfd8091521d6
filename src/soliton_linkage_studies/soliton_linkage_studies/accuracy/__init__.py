# SPDX-License-Identifier: Apache-2.0
"""Errors of estimators and of the analyser, compared with bounds and stated standard deviations.

To add an estimator that uses one frame, register it in `estimators.ESTIMATORS` and write a test.
"""
