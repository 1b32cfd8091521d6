# SPDX-License-Identifier: Apache-2.0
"""Exit with the reason if the suite cannot run on this Python."""

import importlib.util
import sys

version = '.'.join(map(str, sys.version_info[:2]))
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit('Python ' + version + ' is not one of 3.10 to 3.13')
for module in ('ensurepip', 'venv'):
    if importlib.util.find_spec(module) is None:
        sys.exit('Python ' + version + ' has no module ' + module)
