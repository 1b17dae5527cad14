"""A subscriber that shares no code with the publisher: PyPI's cyclonedds, with the definitions that users build.

ros_listener.py DOMAIN TOPIC=TYPE[=transient_local] ...     says `ready` and `matched TOPIC`, listens until its
                                                            standard input ends, and prints all messages as JSON
"""

import json
import pathlib
import sys

ROS = pathlib.Path(__file__).resolve().parents[2] / "ros"
sys.path.insert(0, str(ROS / "tests/ros"))


def main():
    import subscriber
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for folder, package in (
        ("esaac_msgs", "esaac_msgs"),
        ("definitions/event_camera_msgs", "event_camera_msgs"),
    ):
        for file in sorted((ROS / folder / "msg").iterdir()):
            store.register(get_types_from_msg(file.read_text(), f"{package}/msg/{file.stem}"))
    parts = [text.split("=") for text in sys.argv[2:]]
    topics = {part[0]: (part[1], len(part) > 2) for part in parts}
    print(json.dumps(subscriber.listen(int(sys.argv[1]), topics, store)), flush=True)


if __name__ == "__main__":
    main()
