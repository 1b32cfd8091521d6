# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of `soliton-linkage` for shells without `ros2`, with its words and exit codes.

Each module is one, and `main(arguments)` in it is its entry point. They know nothing of the suite
and serve any node; `visitor` is their place in the graph, `fields` turns messages into text.
"""
