# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of `soliton-linkage` with the syntax and exit codes of `ros2`.

Each module is one command with the entry point `main(arguments)`. The commands work with any ROS
node. `visitor` is their temporary node; `fields` converts messages to text.
"""
