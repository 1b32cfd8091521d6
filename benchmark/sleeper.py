# SPDX-License-Identifier: Apache-2.0
"""Loop that only sleeps until each deadline; it prints the wake-up times [ns] at the end."""

from __future__ import annotations

import sys
import time


def main() -> None:
    rate, seconds = map(float, sys.argv[1:])
    start = time.monotonic_ns()
    instants = []
    for tick in range(round(rate * seconds)):
        due = start + round(tick * 1e9 / rate)
        time.sleep(max(0.0, (due - time.monotonic_ns()) * 1e-9))
        instants.append(time.monotonic_ns())
    sys.stdout.write(' '.join(map(str, instants)))


if __name__ == '__main__':
    main()
