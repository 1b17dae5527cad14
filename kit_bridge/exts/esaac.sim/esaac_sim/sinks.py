"""Where events go: files, ROS 2."""

import pathlib

import esaac


class Recorder:
    """Writes a camera's events to a file when the run ends."""

    name = "recorder"

    def __init__(self, folder, spec, suffix=".npz"):
        path = pathlib.Path(folder) / (spec.path.strip("/").replace("/", "_") + suffix)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = esaac.EventWriter(path, spec.sensor)

    def __call__(self, feed, packet):
        self._writer.write(packet)

    def close(self):
        self._writer.close()


class PublishUnavailable(RuntimeError):
    """Events cannot be published to ROS 2 from here, and why."""


def publisher(spec):
    """A sink that publishes a camera's events on its topic.

    The seam for ROS 2: a module `esaac_ros` with `Publisher(topic, frame_id, sensor)`, an object that is called
    with a packet and closed at the end.
    """
    try:
        from esaac_ros import Publisher
    except ImportError as error:
        raise PublishUnavailable(
            f"{spec.path} asks for ROS 2 on {spec.topic}, and publishing is not built into this installation "
            "(there is no module esaac_ros); its events are still recorded and shown"
        ) from error
    made = Publisher(topic=spec.topic, frame_id=spec.frame_id, sensor=spec.sensor)

    class Sink:
        name = "publisher"

        def __call__(self, feed, packet):
            made(packet)

        def close(self):
            made.close()

    return Sink()
