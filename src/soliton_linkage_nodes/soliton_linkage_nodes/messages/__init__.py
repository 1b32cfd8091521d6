# SPDX-License-Identifier: Apache-2.0
"""Messages to physics types and back; nothing else maps message fields."""
