# SPDX-License-Identifier: Apache-2.0
"""Show the fields of messages, services and actions."""

from __future__ import annotations

import re
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from soliton_linkage.command_line import PlainParser, complete

_NESTED = re.compile(r'(?P<package>\w+/)?(?P<name>[A-Z]\w*)(\[[^]]*\])?\s+\w+')
"""Pattern of a field whose type is a message, such as `std_msgs/Header header`."""


def main(arguments: list[str]) -> int:
    """Run the verb `show` and return its exit code."""
    parser = PlainParser(prog='soliton-linkage interface', description=__doc__)
    verbs = parser.add_subparsers(metavar='VERB', required=True)
    show = verbs.add_parser('show', help='print a definition, with the fields of nested messages')
    show.add_argument('type', help='type, such as soliton_linkage_msgs/msg/SolitonState')
    complete(parser)
    print('\n'.join(_lines(parser.parse_args(arguments).type)))
    return 0


def _lines(name: str) -> list[str]:
    package, _, rest = name.partition('/')
    kind = rest.partition('/')[0]
    try:
        path = Path(get_package_share_directory(package), f'{rest}.{kind}')
    except (PackageNotFoundError, ValueError) as error:
        raise ValueError(f'{name}: the package {package} is not installed') from error
    if not path.is_file():
        raise ValueError(
            f'there is no type {name}; give a name such as soliton_linkage_msgs/msg/SolitonState'
        )
    found = []
    for line in path.read_text(encoding='utf-8').splitlines():
        found.append(line)
        if nested := _NESTED.match(line):
            inner = _lines(f'{nested["package"] or package + "/"}msg/{nested["name"]}')
            fields = (each.partition('#')[0].rstrip() for each in inner)
            found += [f'\t{each}' for each in fields if each]
    return found
