# SPDX-License-Identifier: Apache-2.0
"""Point the CMake files of the ROS wheels at this environment, not at the machine they are from.

Usage: mend_wheels.py INCLUDE, the folder of this Python's Python.h.
"""

import re
import sys
from pathlib import Path

import numpy

FOREIGN_NUMPY = re.compile(r'/opt/python/[^/;"]+/lib/[^;"]+/numpy/(_core|core)/include')
FOREIGN_PYTHON = re.compile(r'/opt/python/[^/;"]+/include/python[\d.]+')

include = sys.argv[1]
for path in Path(sys.prefix, 'share').rglob('*.cmake'):
    text = path.read_text(encoding='utf-8')
    mended = FOREIGN_NUMPY.sub(numpy.get_include(), text)
    mended = FOREIGN_PYTHON.sub(include, mended)
    if mended != text:
        path.write_text(mended, encoding='utf-8')
