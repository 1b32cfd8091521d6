# SPDX-License-Identifier: Apache-2.0
"""Files of bags: MCAP, read and written, and the sqlite3 files of rosbag2, read only."""
