# SPDX-License-Identifier: Apache-2.0
"""Files of bags: MCAP (read and written) and sqlite3 of rosbag2 (only read)."""
