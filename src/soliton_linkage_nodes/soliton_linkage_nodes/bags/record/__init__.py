# SPDX-License-Identifier: Apache-2.0
"""Components of the recorder: subscriptions, receiving thread, writing thread, bag writer."""
