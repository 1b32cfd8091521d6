# SPDX-License-Identifier: Apache-2.0
"""Registry of named entries, to which the modules of a package add themselves."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

Entry = TypeVar('Entry')


class Registry(Mapping[str, Entry]):
    """Entries by name, in alphabetical order, added by modules of a package or by other modules.

    The modules of the package are found automatically.
    """

    def __init__(self, package: str) -> None:
        """Create the registry of a package, whose modules are imported at the first access."""
        self._package = package
        self._entries: dict[str, Entry] = {}
        self._complete = False

    def add(self, name: str) -> Callable[[Entry], Entry]:
        """Return a decorator that adds an entry; it raises ValueError for a name in use."""

        def added(entry: Entry) -> Entry:
            if name in self._entries:
                raise ValueError(
                    f'{self._package} already has an entry {name!r}; choose another name'
                )
            self._entries[name] = entry
            return entry

        return added

    def __getitem__(self, name: str) -> Entry:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._all()))

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, Entry]:
        if not self._complete:
            for module in pkgutil.iter_modules(importlib.import_module(self._package).__path__):
                # The module `program` is skipped, because it uses the registry and may run as
                # __main__.
                if module.name != 'program':
                    importlib.import_module(f'{self._package}.{module.name}')
            self._complete = True
        return self._entries
