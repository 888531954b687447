"""What messages become in ROS 2: plain values, and what is made of them by a stand-in for rclpy."""

import json
import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from palpate.launch.files.source_map import InputError
from palpate.messages import schema, type_of_schema
from palpate.messages.types import LogRecord, ShapeModel, TactileFrame, World
from palpate.nodes.runtime.testing import example
from palpate.tools.exporters.ros2_bridge import RosPublishers, main, ros_messages
from tests.tools.recordings import frame as frame_of

POSE = np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8])


@pytest.fixture
def frame():
    array = np.arange(6.0).reshape(2, 3)
    return frame_of(2, finger=1, pose=POSE, array=array, robot_time=1.25)


def by_topic(topic, message):
    return {one.topic: one for one in ros_messages(topic, message)}


def test_frame_is_json_a_stamped_pose_and_an_image(frame):
    shown = by_topic("/touch/raw", frame)
    whole, pose, image = (shown[f"/palpate/touch/raw{part}"] for part in ("", "/pose", "/array"))
    types = ["std_msgs/msg/String", "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/Image"]
    assert [one.type for one in (whole, pose, image)] == types
    fields = json.loads(whole.fields["data"])
    assert (fields["outcome"], fields["array"]) == ("hit", [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    stamp = {"sec": 1, "nanosec": 250_000_000}  # robot time
    assert pose.fields["header"] == {"stamp": stamp, "frame_id": "world"}
    assert pose.fields["pose"]["position"] == {"x": 0.1, "y": 0.2, "z": 0.3}
    assert pose.fields["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}
    fields = image.fields
    assert (fields["height"], fields["width"], fields["step"]) == (2, 3, 12)
    assert np.frombuffer(fields["data"], "<f4").tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_contour_is_a_cloud_and_solid_a_list_of_triangles(contour, tetrahedron):
    cloud = by_topic("/contour/traced", contour)["/palpate/contour/traced/points"]
    assert cloud.type == "sensor_msgs/msg/PointCloud2"
    points = np.frombuffer(cloud.fields["data"], "<f4").reshape(-1, 3)
    assert np.allclose(points, contour.points, atol=1e-7)
    assert cloud.fields["width"] == len(points)
    assert cloud.fields["row_step"] == len(cloud.fields["data"])
    marker = by_topic("/model/shape", tetrahedron)["/palpate/model/shape/mesh"]
    corners = [[one[axis] for axis in "xyz"] for one in marker.fields["points"]]
    assert np.array_equal(corners, tetrahedron.vertices[tetrahedron.faces.ravel()])
    many = replace(tetrahedron, vertices=np.zeros((999, 3)))  # large arrays are given by shape
    whole = by_topic("/m", many)["/palpate/m"]
    assert json.loads(whole.fields["data"])["vertices"] == {"shape": [999, 3]}


def test_own_type_is_mapped_by_its_schema_and_each_message_has_its_topics(frame):
    own = type_of_schema(json.dumps(schema(TactileFrame)))
    message = own(**{name: getattr(frame, name) for name in TactileFrame.__dataclass_fields__})
    assert [*ros_messages("/own", message)] == [*ros_messages("/own", frame)]
    for kind in (World, LogRecord, ShapeModel):
        topics = [one.topic for one in ros_messages("/x", example(kind))]
        assert len({*topics}) == len(topics)
        assert all(topic.startswith("/palpate/x") for topic in topics)


class Profile(NamedTuple):
    depth: int
    reliability: str
    durability: str


class StandIn:
    """As much of rclpy as the bridge uses; every message is a dictionary."""

    def __init__(self, monkeypatch):
        self.published, self.profiles, self.ended = [], {}, []
        qos = SimpleNamespace(
            QoSProfile=Profile,
            DurabilityPolicy=SimpleNamespace(TRANSIENT_LOCAL="latched", VOLATILE="volatile"),
            ReliabilityPolicy=SimpleNamespace(RELIABLE="reliable"),
        )
        contents = {
            "rclpy": {
                "__path__": [],
                "init": lambda args: None,
                "create_node": lambda name: self,
                "shutdown": lambda: self.ended.append("shutdown"),
                "qos": qos,
            },
            "rclpy.qos": vars(qos),
            "rosidl_runtime_py": {
                "__path__": [],
                "set_message_fields": lambda message, fields: message.update(fields),
            },
            "rosidl_runtime_py.utilities": {"get_message": lambda name: dict},
        }
        for name, values in contents.items():
            module = ModuleType(name)
            vars(module).update(values)
            monkeypatch.setitem(sys.modules, name, module)

    def create_publisher(self, cls, topic, profile):
        self.profiles[topic] = profile
        return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

    def destroy_node(self):
        self.ended.append("node")


def test_publishers_are_made_once_and_latched(frame, contour, monkeypatch):
    ros = StandIn(monkeypatch)
    publishers = RosPublishers()
    for topic, message in (("/touch/raw", frame), ("/c", contour), ("/c", contour)):
        for ros_message in ros_messages(topic, message):
            publishers.publish(ros_message, type(message))
    publishers.close()
    assert ros.ended == ["node", "shutdown"]
    assert ros.profiles["/palpate/touch/raw/pose"].durability == "volatile"
    assert ros.profiles["/palpate/c/points"] == Profile(64, "reliable", "latched")
    assert [topic for topic, _ in ros.published].count("/palpate/c/points") == 2


def test_missing_graph_or_ros_2_is_refused(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for words, fragment in (([], "no graph of yours is running"), (["-x"], "No such option")):
        monkeypatch.setattr("sys.argv", ["bridge", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert (ended.value.code, out, err.count("\n")) == (2, "", 1)
        assert err.startswith("palpate: ") and fragment in err
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(InputError, match=r"ROS 2 cannot be imported: .*setup"):
        RosPublishers()
