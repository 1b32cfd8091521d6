# SPDX-License-Identifier: Apache-2.0
"""Parts of the recorder: subscriptions, the receiving and writing threads, the bag writer."""
