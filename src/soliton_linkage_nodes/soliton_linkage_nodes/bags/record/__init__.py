# SPDX-License-Identifier: Apache-2.0
"""Parts of the recorder: subscriptions, the taking and writing threads, the bag writer."""
