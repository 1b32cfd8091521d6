# SPDX-License-Identifier: Apache-2.0
"""Import what several nodes import, once before they start.

The first import of a package compiles its bytecode, and that of matplotlib also lists the
fonts. Five
programs that start at once would each do this work. Packages that are not installed are skipped.
"""

import contextlib
import importlib

NAMES = """
    matplotlib.backends.backend_agg matplotlib.pyplot nicegui.ui rclpy.action rclpy.executors
    rclpy.lifecycle rosbags.rosbag2 rosbags.typesys action_msgs.msg diagnostic_msgs.msg
    geometry_msgs.msg lifecycle_msgs.srv rcl_interfaces.srv sensor_msgs.msg std_msgs.msg
    std_srvs.srv trajectory_msgs.msg visualization_msgs.msg
"""

for name in NAMES.split():
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
