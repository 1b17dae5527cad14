"""What the Kit extension publishes of events' labels, read by a subscriber that shares no code with it."""

import numpy as np
import pytest
from kit_stage import bridge, camera, fresh_stage
from listening import assert_ids, domain, listening
from pxr import UsdSemantics
from test_kit_event_ids import OVERRIDES, WAYS, body, leaves, play
from test_kit_ros import publishes

OUTPUTS = ["events", "event_ids"]


@pytest.fixture
def stage():
    """Two bodies, one of which leaves, and a camera that publishes labels."""
    with fresh_stage() as stage:
        stage.GetPrimAtPath("/camera").GetAttribute("esaac:mode").Set("auto")
        for path, way in {**WAYS, "/cube": leaves}.items():
            body(stage, path, way)
        publishes(stage, "/camera", topic="/robot/davis", outputs=OUTPUTS)
        yield stage


def test_labels_and_prims_are_published(stage, monkeypatch):
    number = domain(7)
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    UsdSemantics.LabelsAPI.Apply(stage.GetPrimAtPath("/cube"), "class").CreateLabelsAttr(["toy", "cube"])
    camera(stage, "/plain", sensor="dvs128", mode="rigid", overrides=OVERRIDES)
    publishes(stage, "/plain")
    running = bridge()
    assert running.attach(stage) == 2 and not running.problems, running.problems
    feed, _ = running.feeds
    expected = []
    feed.sinks.append(lambda feed, packet: expected.append(np.array(feed.forms["event_ids"])))
    topics = running.publisher.topics
    assert not {"/plain/event_ids", "/plain/instances"} & set(topics)
    with listening(number, topics) as (wait, came):
        wait()
        play(8)
        # One more body comes into sight.
        body(stage, "/late", lambda t: ((0.2 + np.sin(9 * t), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        play(10)
        assert not feed.faults, feed.message
        instances = feed.instances
        running.detach()
    assert len(instances) == 3
    # What the first frame gives is the beginning and is not told.
    assert_ids(came["/robot/davis/event_ids"], expected[1:], came["/robot/davis/events"])
    assert {7, 8} <= set(np.concatenate(expected))
    tables = [message["instances"] for message in came["/robot/davis/instances"]]
    assert [len(table) for table in tables] == [2, 3]
    cube = {"id": 7, "name": "/cube", "kinds": ["class", "class"], "labels": ["toy", "cube"]}
    assert tables[0][0] == cube
    assert {each["id"]: each["name"] for each in tables[1]} == {
        number: told["prim"] for number, told in instances.items()
    }
