# SPDX-License-Identifier: Apache-2.0
"""Lets the tests of physics import the chains and the linkage motion that they share."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
