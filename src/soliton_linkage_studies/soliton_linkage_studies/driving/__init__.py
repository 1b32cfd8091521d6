# SPDX-License-Identifier: Apache-2.0
"""One page that validates chains driven by actuators, by a tilt or by the steering."""
