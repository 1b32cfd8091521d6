# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of `soliton-linkage` with the syntax and exit codes of `ros2`, for any ROS node.

In `soliton-linkage topic echo /nudge`, `topic` is the sub-command. The next word, `echo`, is its
verb, which selects an operation. Each module has the entry point `main(arguments)`, except
`visitor`, which contains the node that a command uses.
"""
