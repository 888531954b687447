"""What messages become in ROS 2: plain values, and what is made of them by a stand-in for rclpy."""

import json
import subprocess
import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from palpate.messages.codec import schema
from palpate.messages.described import type_of_schema
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.model import ShapeModel
from palpate.messages.types.touch import TactileFrame
from palpate.messages.types.world import World
from palpate.nodes.runtime.testing import example
from palpate.tools import ros2_bridge
from palpate.tools.exporters.ros2_bridge import RosPublishers, ros_messages

POSE = np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8])


@pytest.fixture
def frame():
    return TactileFrame(
        goal=1,
        touch=2,
        finger=1,
        direction=np.array([1.0, 0.0, 0.0]),
        pose=POSE,
        outcome="hit",
        array=np.arange(6.0).reshape(2, 3),
        robot_time=1.25,
    )


def by_topic(topic, message):
    return {one.topic: one for one in ros_messages(topic, message)}


def test_all_of_a_message_is_told_in_json(frame):
    told = by_topic("/touch/raw", frame)["/palpate/touch/raw"]
    assert told.type == "std_msgs/msg/String"
    fields = json.loads(told.fields["data"])
    assert fields["outcome"] == "hit"
    assert fields["array"] == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]


def test_a_pose_is_stamped_with_robot_time(frame):
    pose = by_topic("/touch/raw", frame)["/palpate/touch/raw/pose"]
    assert pose.type == "geometry_msgs/msg/PoseStamped"
    stamp = {"sec": 1, "nanosec": 250_000_000}
    assert pose.fields["header"] == {"stamp": stamp, "frame_id": "world"}
    assert pose.fields["pose"]["position"] == {"x": 0.1, "y": 0.2, "z": 0.3}
    assert pose.fields["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}


def test_taxels_are_an_image_row_by_row(frame):
    image = by_topic("/touch/raw", frame)["/palpate/touch/raw/array"]
    assert image.type == "sensor_msgs/msg/Image"
    fields = image.fields
    assert (fields["height"], fields["width"], fields["step"]) == (2, 3, 12)
    assert np.frombuffer(fields["data"], "<f4").tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_contour_is_a_cloud_of_its_points(contour):
    cloud = by_topic("/contour/traced", contour)["/palpate/contour/traced/points"]
    assert cloud.type == "sensor_msgs/msg/PointCloud2"
    points = np.frombuffer(cloud.fields["data"], "<f4").reshape(-1, 3)
    assert np.allclose(points, contour.points, atol=1e-7)
    assert cloud.fields["width"] == len(points)
    assert cloud.fields["row_step"] == len(cloud.fields["data"])


def test_a_solid_is_a_list_of_triangles(tetrahedron):
    marker = by_topic("/model/shape", tetrahedron)["/palpate/model/shape/mesh"]
    corners = [[one[axis] for axis in "xyz"] for one in marker.fields["points"]]
    assert np.array_equal(corners, tetrahedron.vertices[tetrahedron.faces.ravel()])


def test_large_arrays_are_told_by_their_shape(tetrahedron):
    many = np.zeros((999, 3))
    from dataclasses import replace

    told = by_topic("/m", replace(tetrahedron, vertices=many))["/palpate/m"]
    assert json.loads(told.fields["data"])["vertices"] == {"shape": [999, 3]}


def test_a_type_of_one_s_own_is_mapped_by_its_schema(frame):
    own = type_of_schema(json.dumps(schema(TactileFrame)))
    message = own(**{name: getattr(frame, name) for name in TactileFrame.__dataclass_fields__})
    assert [*ros_messages("/own", message)] == [*ros_messages("/own", frame)]


@pytest.mark.parametrize("kind", [World, LogRecord, ShapeModel])
def test_every_message_gives_topics_of_its_own(kind):
    found = [*ros_messages("/x", example(kind))]
    assert len({one.topic for one in found}) == len(found)
    assert all(one.topic.startswith("/palpate/x") for one in found)


@dataclass
class Profile:
    depth: int
    reliability: str
    durability: str


@dataclass
class StandIn:
    """As much of rclpy as the bridge uses; every message is a dictionary."""

    published: list = field(default_factory=list)
    profiles: dict = field(default_factory=dict)
    ended: list = field(default_factory=list)

    def create_publisher(self, cls, topic, profile):
        self.profiles[topic] = profile
        return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

    def install(self, monkeypatch):
        modules = {name: ModuleType(name) for name in ("rclpy", "rclpy.qos", "rosidl_runtime_py")}
        rclpy, qos, runtime = modules.values()
        rclpy.__path__ = []
        runtime.__path__ = []
        rclpy.init = lambda args: None
        rclpy.create_node = lambda name: self
        rclpy.shutdown = lambda: self.ended.append("shutdown")
        rclpy.qos = qos
        qos.QoSProfile = Profile
        qos.DurabilityPolicy = SimpleNamespace(TRANSIENT_LOCAL="latched", VOLATILE="volatile")
        qos.ReliabilityPolicy = SimpleNamespace(RELIABLE="reliable")
        runtime.set_message_fields = lambda message, fields: message.update(fields)
        modules["rosidl_runtime_py.utilities"] = utilities = ModuleType("utilities")
        utilities.get_message = lambda name: dict
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, name, module)

    def destroy_node(self):
        self.ended.append("node")


def test_publishers_are_made_once_and_latch_what_is_latched(frame, contour, monkeypatch):
    ros = StandIn()
    ros.install(monkeypatch)
    publishers = RosPublishers()
    for topic, message in (("/touch/raw", frame), ("/c", contour), ("/c", contour)):
        for one in ros_messages(topic, message):
            publishers.publish(one, type(message))
    publishers.close()
    assert ros.ended == ["node", "shutdown"]
    assert ros.profiles["/palpate/touch/raw/pose"].durability == "volatile"
    assert ros.profiles["/palpate/c/points"] == Profile(64, "reliable", "latched")
    assert [topic for topic, _ in ros.published].count("/palpate/c/points") == 2


def test_without_ros_2_or_a_graph_it_is_told_in_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    command = [sys.executable, "-m", "palpate.tools.exporters.ros2_bridge"]
    for words, told in (((), "no graph of yours is running"), (("--topic", "x"), "No such option")):
        done = subprocess.run([*command, *words], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stdout) == (2, "")
        assert told in done.stderr
        assert done.stderr.startswith("palpate: ")
        assert len(done.stderr.splitlines()) == 1
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(ros2_bridge.InputError, match=r"ROS 2 cannot be imported: .*setup"):
        RosPublishers()
