# SPDX-License-Identifier: Apache-2.0
"""Pictures for the pages about viewers: messages of the suite, in the layout of each viewer.

The commands

    make shell
    python3 docs/tool_pictures.py

run a chain for 15 s and write rviz.png, foxglove.png, plotjuggler.png and rqt.png into
docs/pictures. The viewers need not be installed, because matplotlib draws the messages. With the
argument `urdf`, MuJoCo draws urdf.png, and no other picture is written.
"""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import matplotlib.pyplot as plt
import numpy as np
import rclpy
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpecFromSubplotSpec, SubplotSpec
from PIL import Image
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from visualization_msgs.msg import Marker

import soliton_linkage as sl
from soliton_linkage.linkage import robot_description
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.child_processes import private_domain

PICTURES = Path(__file__).parent / 'pictures'
CONFIG = PICTURES.parents[1] / 'config'
VIEWS = CONFIG / 'views'
NODES = ('simulator', 'edge_actuator', 'soliton_analyser', 'visualisation')
TOPICS = (
    interfaces.MARKERS,
    interfaces.KYMOGRAPH,
    interfaces.SOLITON_STATE,
    interfaces.JOINT_STATES,
    interfaces.DIAGNOSTICS,
)
NUDGES = ((2.0, 10.0), (15.0, 0.0))
"""Time [s] and value [rad/s] of each nudge; the last nudge only ends the recording."""
COLOURS, DPI = 64, 65
URDF_SIZE = (800, 130)
Series = dict[str, list[tuple[float, float]]]


def main() -> None:
    """Run a chain and draw the received messages."""
    if sys.argv[1:] == ['urdf']:
        urdf()
        return
    with private_domain():
        received = run()
    series = numbers(received)
    save(rviz(received), 'rviz')
    save(foxglove(received, series), 'foxglove')
    save(plotjuggler(series), 'plotjuggler')
    save(rqt(received, series), 'rqt')


@contextmanager
def running(*programs: str) -> Iterator[None]:
    """Run nodes of the suite as processes until the `with` block ends."""
    parameters = ['--ros-args', '--params-file', str(CONFIG / 'flipper.yaml')]
    start = 'from soliton_linkage_nodes import start; start.{}()'
    processes = [
        subprocess.Popen([sys.executable, '-c', start.format(name), *parameters])
        for name in programs
    ]
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait()


def run() -> dict[str, list[tuple[float, Any]]]:
    """Run the nodes and return the messages of each topic with their times of arrival [s]."""
    rclpy.init()
    user, executor = Node('user'), EventsExecutor()
    executor.add_node(user)
    received = defaultdict(list)
    begin = [0.0]

    def subscribe(topic: interfaces.Topic) -> None:
        def store(message: Any) -> None:
            received[topic.name].append((time.monotonic() - begin[0], message))

        user.create_subscription(topic.type, topic.name, store, topic.qos)

    for topic in TOPICS:
        subscribe(topic)
    nudge = interfaces.NUDGE.publisher(user)
    with running(*NODES):
        while not (received['markers'] and nudge.get_subscription_count()):
            executor.spin_once(timeout_sec=0.05)
        received.clear()
        begin[0] = time.monotonic()
        for moment, value in NUDGES:
            while time.monotonic() - begin[0] < moment:
                executor.spin_once(timeout_sec=0.05)
            nudge.publish(interfaces.NUDGE.type(data=value))
    rclpy.shutdown()
    return {name: list(messages) for name, messages in received.items()}


def numbers(received: dict[str, list[tuple[float, Any]]]) -> dict[str, list[tuple[float, Any]]]:
    """Return the messages with the full name of each topic, which begins with /, as the key."""
    return {f'/{name.lstrip("/")}': messages for name, messages in received.items()}


def values(
    series: dict[str, list[tuple[float, Any]]], path: str
) -> tuple[list[float], list[float]]:
    """Return the times [s] of the messages of a topic, and the values of one of their fields.

    `path` is the topic and the field, for example /soliton_state.solitons[0].rotor. The value is
    NaN if a message does not have this field.
    """
    topic, *fields = path.split('.')
    times, found = [], []
    for moment, message in series[topic]:
        value: Any = message
        for field in fields:
            name, index = re.fullmatch(r'(\w+)(?:\[(\d+)\])?', field).groups()
            value = getattr(value, name, None)
            if index is not None:
                value = (
                    value[int(index)] if value is not None and len(value) > int(index) else None
                )
        times.append(moment)
        found.append(np.nan if value is None else float(value))
    return times, found


def draw_plot(axes: Axes, series: Any, title: str, curves: list[tuple[str, str, str]]) -> None:
    """Draw curves. Each is a tuple of the path of a field (see `values`), a label and a colour."""
    for path, label, colour in curves:
        axes.plot(*values(series, path), color=colour, label=label, linewidth=1)
    axes.set_title(title, fontsize=8, loc='left', pad=2)
    axes.tick_params(labelsize=6)
    axes.grid(color='#d9d9d9', linewidth=0.5)
    if len(curves) > 1:
        axes.legend(fontsize=5, loc='upper left', frameon=False, ncols=3)


def draw_markers(axes: Axes, received: Any) -> None:
    """Draw the last message of the topic `markers` that shows both a wall and a kick."""
    message = next(
        message
        for _, message in reversed(received['markers'])
        if any(m.ns == 'last_kick' and m.action == Marker.ADD for m in message.markers)
        and any(m.ns == 'solitons' for m in message.markers)
    )
    for marker in message.markers:
        points = np.array([[p.x, p.z] for p in marker.points])
        colours = [(c.r, c.g, c.b, c.a) for c in marker.colors]
        own = marker.color
        if marker.type == Marker.LINE_LIST and len(points):
            lines = LineCollection(list(points.reshape(-1, 2, 2)), colors=colours[::2])
            lines.set_linewidth(1.5)
            axes.add_collection(lines)
        elif marker.type == Marker.SPHERE_LIST:
            axes.scatter(*points.T, c=colours, s=12, zorder=3)
        elif marker.type == Marker.CUBE:
            x, z = marker.pose.position.x, marker.pose.position.z
            size = marker.scale
            corner = (x - size.x / 2, z - size.z / 2)
            axes.add_patch(
                plt.Rectangle(corner, size.x, size.z, color=(own.r, own.g, own.b), alpha=own.a)
            )
        elif marker.type == Marker.TEXT_VIEW_FACING:
            position = marker.pose.position
            axes.text(
                position.x, position.z, marker.text, fontsize=7, ha='center', color='#7f7f7f'
            )
    axes.set_aspect('equal')
    axes.set_xlim(-0.1, 4.0)
    axes.set_ylim(-0.2, 0.6)
    axes.axis('off')


def draw_image(axes: Axes, received: Any) -> None:
    """Draw the last image of the topic `kymograph`."""
    picture = received['kymograph'][-1][1]
    axes.imshow(np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3))
    axes.set_aspect('auto')
    axes.axis('off')


def draw_diagnostics(axes: Axes, received: Any) -> None:
    """Write the last diagnostic message of each node into the axes."""
    status = {s.name: s.message for _, array in received['/diagnostics'] for s in array.status}
    axes.text(0, 1, '\n'.join(f'{n}: {m}' for n, m in status.items()), fontsize=6, va='top')
    axes.axis('off')


def rviz(received: Any) -> Figure:
    """Return a figure with the displays of RViz: the markers, and the kymograph below them."""
    figure = plt.figure(figsize=(9, 4.2), layout='constrained')
    above, below = figure.subplots(2, 1, height_ratios=(1, 1.2))
    draw_markers(above, received)
    draw_image(below, received)
    return figure


def foxglove(received: Any, series: Any) -> Figure:
    """Return a figure with the panels of foxglove.json, arranged as in Foxglove."""
    held = json.loads((VIEWS / 'foxglove.json').read_text(encoding='utf-8'))
    figure = plt.figure(figsize=(10, 6))
    panels = held['configById']

    def add_panels(tree: Any, spot: SubplotSpec) -> None:
        if not isinstance(tree, str):
            share = tree['splitPercentage']
            shares = (share, 100 - share)
            row = tree['direction'] == 'row'
            shape = {'ncols': 2, 'width_ratios': shares} if row else {'nrows': 2}
            shape |= {} if row else {'height_ratios': shares}
            shape = {'nrows': 1, 'ncols': 1, **shape}
            grid = GridSpecFromSubplotSpec(subplot_spec=spot, wspace=0.14, hspace=0.3, **shape)
            add_panels(tree['first'], grid[0])
            add_panels(tree['second'], grid[1])
            return
        axes, panel = figure.add_subplot(spot), panels[tree]
        kind = tree.partition('!')[0]
        if kind == 'Plot':
            curves = [(p['value'], p['label'], p['color']) for p in panel['paths']]
            draw_plot(axes, series, panel['foxglovePanelTitle'], curves)
        elif kind == '3D':
            draw_markers(axes, received)
        elif kind == 'Image':
            draw_image(axes, received)
        elif kind in ('Publish', 'CallService'):
            box = {'facecolor': panel['buttonColor'], 'pad': 6, 'edgecolor': 'none'}
            axes.text(0.1, 0.5, panel['buttonText'], color='white', bbox=box, fontsize=8)
            axes.axis('off')
        else:
            draw_diagnostics(axes, received)

    outer = figure.add_gridspec(1, 1, left=0.04, right=0.99, top=0.99, bottom=0.05)
    add_panels(held['layout'], outer[0])
    return figure


def plotjuggler(series: Any) -> Figure:
    """Return a figure with the plots of the first tab in plotjuggler.xml."""
    tab = Xml.parse(VIEWS / 'plotjuggler.xml').find('.//Tab')
    areas = list(tab.iter('DockArea'))
    figure = plt.figure(figsize=(8, 4.2), layout='constrained')
    for axes, area in zip(figure.subplots(len(areas), 1, sharex=True), areas, strict=True):
        curves = [
            (c.get('topic') + c.get('field').replace('/', '.'), c.get('field')[1:], c.get('color'))
            for c in area.iter('curve')
        ]
        draw_plot(axes, series, area.get('name'), curves)
    return figure


def rqt(received: Any, series: Any) -> Figure:
    """Return a figure with the plugins of rqt.perspective: kymograph, plots and diagnostics."""
    held = json.loads((VIEWS / 'rqt.perspective').read_text(encoding='utf-8'))
    plugins = held['groups']['pluginmanager']['groups'].items()
    figure = plt.figure(figsize=(9, 4), layout='constrained')
    spots = iter(figure.subplots(2, 3).ravel())
    colours = [f'C{number}' for number in range(10)]
    for name, plugin in plugins:
        keys = plugin['groups']['plugin']['keys']
        if 'ImageView' in name:
            draw_image(next(spots), received)
        elif 'RobotMonitor' in name:
            draw_diagnostics(next(spots), received)
        else:
            paths = [p[1:].replace('/', '.') for p in ast.literal_eval(keys['topics']['repr'])]
            shown = [
                (f'/{path}', path.rpartition('.')[2], colour)
                for path, colour in zip(paths, colours, strict=False)
            ]
            draw_plot(next(spots), series, paths[0].partition('.')[2].rpartition('.')[0], shown)
    return figure


def urdf() -> None:
    """Write urdf.png, in which MuJoCo draws the URDF of a chain, without a display."""
    os.environ |= {'MUJOCO_GL': 'egl', 'PYOPENGL_PLATFORM': 'egl'}
    try:
        import mujoco
    except ImportError:
        sys.exit('tool_pictures: urdf.png needs MuJoCo; run: pip install mujoco')
    chain = sl.Chain(number_of_rotors=12)
    model = mujoco.MjModel.from_xml_string(robot_description(chain))
    model.vis.headlight.ambient[:] = 0.6
    model.vis.global_.fovy = 15
    model.vis.rgba.haze[:] = 1.0
    data = mujoco.MjData(model)
    data.qpos[:] = sl.with_soliton(chain, 5.5, 0.0).angles
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = chain.pivots[-1] / 2, 0.0, 0.0
    camera.distance, camera.azimuth, camera.elevation = 0.75, 90.0, -12.0
    model.vis.global_.offwidth, model.vis.global_.offheight = URDF_SIZE
    with mujoco.Renderer(model, URDF_SIZE[1], URDF_SIZE[0]) as renderer:
        renderer.update_scene(data, camera)
        pixels = renderer.render()
    path = PICTURES / 'urdf.png'
    Image.fromarray(np.where(pixels.any(axis=2, keepdims=True), pixels, 255)).save(path)
    shrink(path)


def save(figure: Figure, name: str) -> None:
    """Write a figure to docs/pictures/NAME.png, and close the figure."""
    path = PICTURES / f'{name}.png'
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
    shrink(path)


def shrink(path: Path) -> None:
    """Reduce the number of colours of a picture file to COLOURS, so that the file is small."""
    with Image.open(path) as picture:
        small = picture.convert('RGB').quantize(
            COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
    small.save(path, optimize=True)
    sys.stdout.write(f'{path}\n')


if __name__ == '__main__':
    main()
