# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of MCAP files, and reading of the sqlite3 files of rosbag2."""
