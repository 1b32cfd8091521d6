# SPDX-License-Identifier: Apache-2.0
"""Files of bags: MCAP files are read and written, sqlite3 files of rosbag2 only read."""
