# SPDX-License-Identifier: Apache-2.0
"""Say why this Python cannot carry the suite; say nothing if it can."""

import sys

name = '%s (Python %d.%d)' % (sys.executable, sys.version_info[0], sys.version_info[1])
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit(name + ' is not one of Python 3.10 to 3.13')
try:
    import ensurepip  # noqa: F401
    import venv  # noqa: F401
except ImportError as error:
    sys.exit('%s has no module %s' % (name, error.name))
