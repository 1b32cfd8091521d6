# SPDX-License-Identifier: Apache-2.0
"""Settings of hypothesis: the same examples in every run, unless told `--hypothesis-profile`."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    'repeatable', deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile(
    'searching', parent=settings.get_profile('repeatable'), derandomize=False, max_examples=2000
)
settings.load_profile('repeatable')
