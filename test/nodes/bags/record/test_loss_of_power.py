# SPDX-License-Identifier: Apache-2.0
"""A power failure loses at most `sync_interval` of messages if the disk keeps synced data only."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from graphs import values
from recordings import messages_of, publish_frames

from soliton_linkage_nodes.bags.recovery import recover_bag
from soliton_linkage_nodes.runtime import interfaces

SOURCE = Path(__file__).with_name('forgetful_disk.c')


@pytest.fixture(scope='module')
def disk(tmp_path_factory):
    """A library to be preloaded."""
    library = tmp_path_factory.mktemp('disk') / 'forgetful_disk.so'
    command = [os.environ.get('CC', 'cc'), '-shared', '-fPIC', '-O1', '-o', library, SOURCE]
    subprocess.run([*command, '-ldl'], check=True)
    return library


def test_synchronised_messages_are_kept(graph, start, named, tmp_path, disk):
    kept = tmp_path / 'kept_0'
    (kept / 'names').mkdir(parents=True)
    given = {'output': tmp_path / 'run', 'sync_interval': 0.5}
    program = start(
        'bag_recorder',
        '--ros-args',
        *(part for name, value in given.items() for part in ('-p', f'{name}:={value}')),
        command=['env', f'LD_PRELOAD={disk}', f'KEPT={kept}'],
    )
    publisher = graph.speak(interfaces.JOINT_STATES)
    reports = graph.reports('bag_recorder')
    graph.until(
        lambda: reports and '/joint_states' in values(reports[-1])['topics received'],
        'the recorder to receive',
    )
    sent = publish_frames(publisher, named, 200)
    graph.until(
        lambda: any(sent[-1] in path.read_bytes() for path in kept.glob('run*')),
        'the synchronisation',
    )
    sent += publish_frames(publisher, named, 200)
    program.process.kill()
    program.process.wait()
    named_files = {path.name for path in (kept / 'names').iterdir()}
    shutil.rmtree(kept / 'names')
    for path in kept.iterdir():
        assert path.name in named_files
    assert 'run_0' in named_files
    _, new = recover_bag(kept, tmp_path / 'new')
    recovered = messages_of(new)['/joint_states']
    assert recovered == sent[: len(recovered)]
    assert len(recovered) >= 200
