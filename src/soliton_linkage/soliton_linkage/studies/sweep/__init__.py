# SPDX-License-Identifier: Apache-2.0
"""Any parameter swept, on all cores or on a cluster."""
