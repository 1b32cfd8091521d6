# SPDX-License-Identifier: Apache-2.0
"""Files of bags: MCAP, read and written, and rosbag2's sqlite3 files, read only."""
