# SPDX-License-Identifier: Apache-2.0
"""Point the CMake files of the ROS wheels at this environment, not at the machine they are from.

CMake also reads lists of files as UTF-8, because the path of the workspace may have any letters.

Usage: mend_wheels.py INCLUDE, the folder of this Python's Python.h.
"""

import re
import sys
from pathlib import Path

import numpy

FOREIGN_NUMPY = re.compile(r'/opt/python/[^/;"]+/lib/[^;"]+/numpy/(_core|core)/include')
FOREIGN_PYTHON = re.compile(r'/opt/python/[^/;"]+/include/python[\d.]+')
LIST_OF_FILES = 'file(STRINGS "${idl_output}" idl_tuples)'

include = sys.argv[1]
for path in Path(sys.prefix, 'share').rglob('*.cmake'):
    text = path.read_text(encoding='utf-8')
    mended = FOREIGN_NUMPY.sub(numpy.get_include(), text)
    mended = FOREIGN_PYTHON.sub(include, mended)
    mended = mended.replace(LIST_OF_FILES, f'{LIST_OF_FILES[:-1]} ENCODING UTF-8)')
    if mended != text:
        path.write_text(mended, encoding='utf-8')
