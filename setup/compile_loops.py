# SPDX-License-Identifier: Apache-2.0
"""Compile the loops of the modules in some folders, in two processes.

Usage: compile_loops.py FOLDER ...
"""

import importlib
import multiprocessing
import sys
from pathlib import Path


def compile_loops(folder):
    """Import all modules in a folder that have compiled loops."""
    for path in sorted(Path(folder).rglob('*.py')):
        if 'soliton_linkage.compiling import' in path.read_text(encoding='utf-8'):
            importlib.import_module('.'.join(path.with_suffix('').parts[2:]))
    integrators = sys.modules.get('soliton_linkage.dynamics.integrators')
    if integrators:
        integrators.SymplecticNystrom.load()


if __name__ == '__main__':
    # Both processes use this import, which takes seconds before its bytecode is written.
    for name in ('scipy.integrate', 'scipy.optimize', 'soliton_linkage.compiling'):
        importlib.import_module(name)
    with multiprocessing.get_context('fork').Pool(2) as pool:
        pool.map(compile_loops, sys.argv[1:], chunksize=1)
