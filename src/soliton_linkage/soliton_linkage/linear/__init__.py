# SPDX-License-Identifier: Apache-2.0
"""Linear theory about one configuration: rigidity, bands, normal modes and statics."""
