# SPDX-License-Identifier: Apache-2.0
"""Nodes in the environment of the suite are visible on this machine only.

Nor does it use the middleware's shared memory: what a process leaves there half made that was
killed at its start, all others of the machine wait for.
"""

from pathlib import Path

from soliton_linkage_nodes.messages.conversions import chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

ROOT = Path(__file__).parents[2]
ENTER = (
    'unset ROS_AUTOMATIC_DISCOVERY_RANGE FASTRTPS_DEFAULT_PROFILES_FILE; '
    f'. {ROOT}/setup/environment.sh; exec "$0" "$@"'
)


def addresses(process: int) -> set[str]:
    """Local addresses of the sockets of a process, IPv4 and IPv6."""
    links = (str(file.readlink()) for file in Path(f'/proc/{process}/fd').iterdir())
    sockets = {link[8:-1] for link in links if link.startswith('socket:[')}
    found = set()
    for protocol in ('udp', 'udp6', 'tcp', 'tcp6'):
        for line in Path(f'/proc/{process}/net/{protocol}').read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in sockets:
                raw = bytes.fromhex(fields[1].partition(':')[0])
                found.add('.'.join(map(str, raw[::-1])) if len(raw) == 4 else raw.hex())
    return found


def test_a_node_in_a_graph_binds_the_loopback_alone_and_shares_no_memory(graph, start, named):
    node = start('edge_actuator', command=['bash', '-c', ENTER])
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(0)))
    graph.until(lambda: any('/chain describes' in line for line in node.said), 'the chain')
    assert addresses(node.process.pid) == {'127.0.0.1'}
    assert '/dev/shm/fastrtps' not in Path(f'/proc/{node.process.pid}/maps').read_text()
