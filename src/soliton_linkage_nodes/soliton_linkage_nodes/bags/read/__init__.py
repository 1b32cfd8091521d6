# SPDX-License-Identifier: Apache-2.0
"""Reading bags: messages, older definitions, records of MCAP files."""
