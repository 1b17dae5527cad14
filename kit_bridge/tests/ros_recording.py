"""Reads a recording with PyPI's rosbags, by the definitions that are in it, and prints all messages as JSON.

ros_recording.py FILE.mcap
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "ros/tests/ros"))


def main():
    import subscriber

    messages = subscriber.Recording(pathlib.Path(sys.argv[1])).messages
    print(json.dumps({topic: [message for _, message in came] for topic, came in messages.items()}))


if __name__ == "__main__":
    main()
