# SPDX-License-Identifier: Apache-2.0
"""Feed corrupted bags, texts and messages to all readers until interrupted.

Failing inputs are minimised and stored in test/fuzz/corpus, which the tests repeat.
"""

import argparse
import hashlib
import itertools
import os
import resource
import sys
import time
import traceback
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from readers import TARGETS, wounded

MOST_MEMORY = 2**29
"""Maximum memory above the initial memory of the process [B]."""
LONGEST = 10.0
"""Maximum time per input [s]."""
EXAMPLES = 200
"""Number of inputs per target in one turn [1]."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=10.0, help='(%(default)s)')
    parser.add_argument('--target', choices=TARGETS, action='append', help='(all)')
    parser.add_argument('--seed', type=int, default=time.time_ns() % 10**9, help='(the time)')
    options = parser.parse_args()
    # Discard the thousands of messages that the middleware prints for rejected input.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
    begin, tried = time.monotonic(), dict.fromkeys(options.target or TARGETS, 0)
    found = []
    for name in tried:
        TARGETS[name].feed(TARGETS[name].examples()[0])
    least = peak_memory()
    for number, name in zip(itertools.count(options.seed), itertools.cycle(tried)):
        if time.monotonic() - begin > 60 * options.minutes:
            break
        tried[name] += EXAMPLES
        kept = fuzz(name, number)
        found += [kept] if kept else []
        print(f'\r{sum(tried.values())} inputs, {len(found)} found', end='', flush=True)
    taken = peak_memory() - least
    counts = ', '.join(f'{name} {count}' for name, count in tried.items())
    print(f'\n{counts}; seed {options.seed}; at most {taken // 2**20} MiB more')
    print('clean' if not found else '\n'.join(f'not rejected: {path}' for path in found))
    sys.exit(bool(found) or taken > MOST_MEMORY)


def peak_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def fuzz(name: str, number: int) -> Path | None:
    """Test a target with many inputs; store and report the smallest that is not rejected."""
    last = b''

    @seed(number)
    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(wounded(TARGETS[name].examples()))
    def feed(content: bytes) -> None:
        nonlocal last
        last = content
        begin = time.monotonic()
        TARGETS[name].feed(content)
        took = time.monotonic() - begin
        if took > LONGEST:
            raise AssertionError(f'it took {took:.1f} s')

    try:
        feed()
    except Exception:
        traceback.print_exc(file=sys.stdout)
        digest = hashlib.sha256(last).hexdigest()[:8]
        path = Path(__file__).parent / 'corpus' / f'{name}-{digest}'
        path.write_bytes(last)
        return path
    return None


if __name__ == '__main__':
    main()
