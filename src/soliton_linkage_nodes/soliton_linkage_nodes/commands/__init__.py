# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of `soliton-linkage` with the syntax and exit codes of `ros2`.

Each module is one command with the entry point `main(arguments)`, except `visitor`, which contains
the temporary node of the commands. The commands work with the nodes of any ROS package.
"""
