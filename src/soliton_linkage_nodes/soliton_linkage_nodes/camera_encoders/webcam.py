# SPDX-License-Identifier: Apache-2.0
"""A thread that takes pictures of a camera of this machine."""

from __future__ import annotations

import threading
from collections.abc import Callable

from soliton_linkage.vision.footage import camera_pictures
from soliton_linkage.vision.opencv import Picture, opencv

_LONGEST_WAIT = 5.0
"""Until the thread has ended [s], which waits for a picture at most."""


class Webcam:
    """Takes pictures until it is closed, each as soon as the one before was looked at."""

    def __init__(
        self,
        number: int,
        take: Callable[[Picture], None],
        fail: Callable[[str], None],
    ) -> None:
        """Have each picture taken, and told once what it fails of, in the thread."""
        opencv()
        self._closing = threading.Event()
        self._number, self._take, self._fail = number, take, fail
        self._thread = threading.Thread(target=self._run, name='camera', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take no more."""
        self._closing.set()
        self._thread.join(_LONGEST_WAIT)

    def _run(self) -> None:
        try:
            for taken in camera_pictures(self._number):
                if self._closing.is_set():
                    return
                self._take(taken.picture)
        except ValueError as error:
            self._fail(str(error))
