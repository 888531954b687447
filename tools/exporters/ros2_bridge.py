"""Publishes the topics of a running graph in a ROS 2 graph, where `rclpy` is installed.

    python -m palpate.tools.exporters.ros2_bridge --topics /touch/patch,/model/shape

Each message becomes messages of standard ROS 2 packages, so that nothing has to be built: the whole
message as JSON on ``/palpate/TOPIC``, and what RViz can draw on topics below, named by the field:
poses, images of taxels, points, and a mesh. This file was tested with a stand-in for `rclpy` only.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import click
import msgspec
import numpy as np

from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.processes.registry import find_run
from palpate.messages import decode, schema
from palpate.messages.types import ALL_KEPT, LATCHED
from palpate.tools.introspection.topics import (
    TapSubscription,
    Topic,
    find_topics,
    topics_of,
    type_of,
)

NAMESPACE = "/palpate"
FRAME = "world"  # of all poses and points
TRIANGLE_LIST, FLOAT32 = 11, 7  # of visualization_msgs/Marker and sensor_msgs/PointField


class RosMessage(NamedTuple):
    """A message for ROS 2 in plain values."""

    topic: str
    type: str  # such as ``std_msgs/msg/String``
    fields: dict[str, Any]


def ros_messages(topic: str, message: object) -> Iterator[RosMessage]:
    """Messages for ROS 2 of a message on a topic, whose type may be a user's own.

    Recognised fields: poses (7,), images (rows, cols), points (n, 3) [m], `vertices` with `faces`.
    """
    base, rules = f"{NAMESPACE}{topic}", schema(type(message))["properties"]
    header = {"stamp": _stamp(getattr(message, "robot_time", 0.0)), "frame_id": FRAME}
    text = msgspec.json.encode(_values(message, rules), enc_hook=_plain).decode()
    yield RosMessage(base, "std_msgs/msg/String", {"data": text})
    for name, rule in rules.items():
        value, shape = getattr(message, name), [*rule.get("shape", ())]
        if shape == [7]:
            stamped = {"header": header, "pose": _pose(value)}
            yield RosMessage(f"{base}/{name}", "geometry_msgs/msg/PoseStamped", stamped)
        elif shape == [None, None] and rule["dtype"] == "<f8":
            yield RosMessage(f"{base}/{name}", "sensor_msgs/msg/Image", _image(header, value))
        elif shape == [None, 3] and rule["unit"] == "m" and "faces" not in rules:
            yield RosMessage(f"{base}/{name}", "sensor_msgs/msg/PointCloud2", _cloud(header, value))
    if {"vertices", "faces"} <= rules.keys():
        corners = message.vertices[message.faces.ravel()]  # type: ignore[attr-defined]
        yield RosMessage(f"{base}/mesh", "visualization_msgs/msg/Marker", _marker(header, corners))


def _values(message: object, rules: dict[str, Any]) -> dict[str, Any]:
    return {name: getattr(message, name) for name in rules}


def _plain(value: Any, max_elements: int = 1024) -> Any:
    """An array as nested lists, or only its shape if it has more than `max_elements`."""
    if not isinstance(value, np.ndarray):
        raise NotImplementedError
    return value.tolist() if value.size <= max_elements else {"shape": [*value.shape]}


def _stamp(seconds: float) -> dict[str, int]:
    """A time [s] as ROS 2 has it, rounded down to 1 ns."""
    whole = int(seconds)
    return {"sec": whole, "nanosec": int((seconds - whole) * 1e9)}


def _pose(pose: Any) -> dict[str, Any]:
    values = [float(value) for value in pose]
    position, turn = zip("xyz", values, strict=False), zip("xyzw", values[3:], strict=True)
    return {"position": dict(position), "orientation": dict(turn)}


def _image(header: dict[str, Any], image: Any) -> dict[str, Any]:
    rows, cols = image.shape
    return {
        "header": header,
        "height": rows,
        "width": cols,
        "encoding": "32FC1",
        "is_bigendian": 0,
        "step": 4 * cols,
        "data": image.astype("<f4").tobytes(),
    }


def _cloud(header: dict[str, Any], points: Any) -> dict[str, Any]:
    fields = [
        {"name": name, "offset": 4 * place, "datatype": FLOAT32, "count": 1}
        for place, name in enumerate("xyz")
    ]
    return {
        "header": header,
        "height": 1,
        "width": len(points),
        "fields": fields,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * len(points),
        "data": points.astype("<f4").tobytes(),
        "is_dense": True,
    }


def _marker(header: dict[str, Any], corners: Any) -> dict[str, Any]:
    """A list of triangles, three corners each."""
    return {
        "header": header,
        "ns": "palpate",
        "type": TRIANGLE_LIST,
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
        "color": {"r": 0.6, "g": 0.7, "b": 0.8, "a": 1.0},
        "points": [dict(zip("xyz", corner, strict=True)) for corner in corners.tolist()],
    }


class RosPublishers:
    """Publishers of one ROS 2 node, made with the first message of each topic.

    `depth`: messages that a publisher keeps. Raises InputError if this Python has no ROS 2.
    """

    def __init__(self, depth: int = 64) -> None:
        try:
            import rclpy
            from rclpy import qos
            from rosidl_runtime_py import set_message_fields
            from rosidl_runtime_py.utilities import get_message
        except ImportError as error:
            raise InputError(
                f"ROS 2 cannot be imported: {error}; source its setup file in this shell, and have "
                f"it for Python {sys.version_info.major}.{sys.version_info.minor}"
            ) from None
        rclpy.init(args=[])
        self._depth = depth
        self._rclpy, self._qos = rclpy, qos
        self._set_fields, self._get_type = set_message_fields, get_message
        self._node = rclpy.create_node("palpate_bridge")
        self._publishers: dict[str, tuple[Any, Any]] = {}

    def publish(self, message: RosMessage, kind: type) -> None:
        """Publish a message made from one of type `kind`; it is latched if `kind` is."""
        if message.topic not in self._publishers:
            durability = self._qos.DurabilityPolicy
            profile = self._qos.QoSProfile(
                depth=1 if kind in LATCHED - ALL_KEPT else self._depth,
                reliability=self._qos.ReliabilityPolicy.RELIABLE,
                durability=durability.TRANSIENT_LOCAL if kind in LATCHED else durability.VOLATILE,
            )
            cls = self._get_type(message.type)
            made = self._node.create_publisher(cls, message.topic, profile)
            self._publishers[message.topic] = cls, made
        cls, publisher = self._publishers[message.topic]
        filled = cls()
        self._set_fields(filled, message.fields)
        publisher.publish(filled)

    def close(self) -> None:
        """Leave the ROS 2 graph."""
        self._node.destroy_node()
        self._rclpy.shutdown()


def bridge(run: str | None, names: Sequence[str], echo: Callable[[str], None]) -> None:
    """Publish topics of a running graph, all if none is named, until the graph ends or Ctrl-C.

    Raises InputError if there is no such graph or topic, or no ROS 2.
    """
    with as_input_errors():
        card = find_run(run)
        topics: list[Topic] = find_topics(card, names or [*topics_of(card)])
        types = {topic.name: type_of(topic) for topic in topics}
    publishers = RosPublishers()
    try:
        with TapSubscription(card, topics, latched=True) as taps:
            echo(f"publishing {len(topics)} topics of {card.name} in ROS 2; Ctrl-C ends it")
            for received in chain.from_iterable(taps.batches()):
                kind = types[received.topic]
                for message in ros_messages(received.topic, decode(kind, received.body)):
                    publishers.publish(message, kind)
    finally:
        publishers.close()


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--topics", default="", metavar="A,B", help="Only these topics.")
@click.option("--run", metavar="ID", help="The graph, as of palpate topic.")
def bridge_command(topics: str, run: str | None) -> None:
    """Publish the topics of a running graph in a ROS 2 graph, below /palpate."""
    bridge(run, [name for name in map(str.strip, topics.split(",")) if name], click.echo)


def main() -> None:
    """Do what the command line asks for, and exit."""
    try:
        bridge_command.main(
            prog_name="python -m palpate.tools.exporters.ros2_bridge", standalone_mode=False
        )
    except (InputError, click.ClickException) as error:
        text = error.format_message() if isinstance(error, click.ClickException) else error
        print(f"palpate: {text}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
