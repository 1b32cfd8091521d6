# SPDX-License-Identifier: Apache-2.0
"""Node that serves a web page. The page shows moving chains and sends commands to them."""
