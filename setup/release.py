# SPDX-License-Identifier: Apache-2.0
"""Build wheels and source archives twice, and keep them where both are the same to the byte.

Both builds use the last commit. They differ in folder names, times, hash seeds and file modes. The
archives contain the time of the commit.
"""

import gzip
import hashlib
import io
import os
import shutil
import stat
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ('soliton_linkage', 'soliton_linkage_studies', 'soliton_linkage_nodes')
WAYS = (('first', '1', 0o022, 'UTC'), ('a_second_time', '2', 0o077, 'Asia/Tokyo'))


def main():
    """Build into out/release, or exit with the differences."""
    output = ROOT / 'out/release'
    epoch = git('log', '-1', '--format=%ct').decode().strip()
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as folder:
        first, second = (built(Path(folder), way, epoch) for way in WAYS)
    differing = sorted(name for name in first | second if first.get(name) != second.get(name))
    if differing:
        sys.exit(f'release: two builds of {", ".join(differing)} differ; none is kept')
    for name, data in first.items():
        (output / name).write_bytes(data)
    sums = ''.join(f'{hashlib.sha256(d).hexdigest()}  {n}\n' for n, d in sorted(first.items()))
    (output / 'SHA256SUMS').write_text(sums, encoding='utf-8')
    print(f'{sums}The same from two builds; they are in {output.relative_to(ROOT)}.')
    if git('status', '--porcelain', '--untracked-files=no'):
        print('What has not been committed is not in them.')


def built(folder, way, epoch):
    """Return the bytes of each archive that a build of the last commit gives."""
    name, seed, mask, zone = way
    home = folder / name
    before = os.umask(mask)
    try:
        source = git('archive', '--format=tar', 'HEAD')
        with tarfile.open(fileobj=io.BytesIO(source)) as archive:
            archive.extractall(
                home, **({'filter': 'data'} if hasattr(tarfile, 'data_filter') else {})
            )
        environment = {
            **os.environ,
            'SOURCE_DATE_EPOCH': epoch,
            'PYTHONHASHSEED': seed,
            'TZ': zone,
        }
        for path in home.rglob('*'):
            if not path.is_symlink():
                path.chmod(0o755 if path.is_dir() or path.stat().st_mode & 0o100 else 0o644)
        for package in PACKAGES:
            subprocess.run(
                [sys.executable, '-W', 'ignore', 'setup.py', '--quiet', 'sdist', 'bdist_wheel'],
                cwd=home / 'src' / package,
                env=environment,
                stderr=subprocess.DEVNULL,
                check=True,
            )
    finally:
        os.umask(before)
    found = {path.name: path.read_bytes() for path in home.glob('src/*/dist/*')}
    found['soliton_linkage_workspace.tar.gz'] = gzip.compress(source)
    return {
        name: (rezipped if name.endswith('.whl') else repacked)(data, int(epoch))
        for name, data in found.items()
    }


def rezipped(archive, epoch):
    """Return a wheel with its members in order, without times and rights of a machine."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as source, zipfile.ZipFile(packed, 'w') as target:
        for name in sorted(source.namelist()):
            member = zipfile.ZipInfo(name, time.gmtime(epoch)[:6])
            member.external_attr = (stat.S_IFREG | 0o644) << 16
            member.compress_type = zipfile.ZIP_DEFLATED
            target.writestr(member, source.read(name))
    return packed.getvalue()


def repacked(archive, epoch):
    """Return a packed archive with its members in order, without times and owners of a machine."""
    packed = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(archive), mode='r:gz') as source,
        gzip.GzipFile(filename='', fileobj=packed, mode='wb', mtime=epoch) as stream,
        tarfile.open(fileobj=stream, mode='w', format=tarfile.PAX_FORMAT) as target,
    ):
        for member in sorted(source.getmembers(), key=lambda member: member.name):
            member.mtime, member.uid, member.gid = epoch, 0, 0
            member.uname = member.gname = ''
            member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            member.pax_headers = {}
            target.addfile(member, source.extractfile(member) if member.isfile() else None)
    return packed.getvalue()


def git(*arguments):
    """Return the output of a git command in this repository."""
    return subprocess.run(['git', *arguments], cwd=ROOT, check=True, capture_output=True).stdout


if __name__ == '__main__':
    main()
