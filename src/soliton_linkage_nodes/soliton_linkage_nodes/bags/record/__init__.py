# SPDX-License-Identifier: Apache-2.0
"""Components of the recorder: subscriptions, receiving and writing threads, and bag writer."""
