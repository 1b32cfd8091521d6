# SPDX-License-Identifier: Apache-2.0
"""Report requirements without a pin, and lines of constraints.txt that are no pins."""

import re
import sys
from pathlib import Path

HOME = Path(__file__).parent
NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]*')
PIN = re.compile(r'[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+(; python_version (<|>=) \'3\.\d+\')?')


def lines_of(path):
    """Return the lines of a file without comments and empty ones."""
    stripped = (line.partition('#')[0].strip() for line in path.read_text('utf-8').splitlines())
    return [line for line in stripped if line]


def canonical(requirement):
    """Return the name that a requirement begins with, as package indexes compare it."""
    return re.sub(r'[-_.]+', '-', NAME.match(requirement).group()).lower()


def problems(home):
    """Return a line for each requirement without a pin, and for each pin that is none."""
    pins = lines_of(home / 'constraints.txt')
    said = [f'constraints.txt: {pin!r} is no pin' for pin in pins if not PIN.fullmatch(pin)]
    pinned = {canonical(pin) for pin in pins}
    for path in sorted(home.glob('requirements-*.txt')):
        said += [
            f'{path.name}: {requirement} has no pin in constraints.txt'
            for requirement in lines_of(path)
            if canonical(requirement) not in pinned
        ]
    return said


if __name__ == '__main__':
    sys.exit('\n'.join(problems(HOME)) or None)
