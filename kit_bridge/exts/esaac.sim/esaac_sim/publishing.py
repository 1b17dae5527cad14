"""Cameras of a stage on ROS 2: one publisher for all, and a sink for each."""

import time

from esaac import ros

from .imu import Imu

STATUS_S = 1.0
"""Time between two looks at a camera's counts and warnings, which are published once a second."""


def publisher(specs):
    """A publisher of these cameras, each below its own topic."""
    return ros.Publisher([_camera(spec) for spec in specs], namespace="/", node="esaac_sim")


def _name(spec):
    # The publisher's namespace is `/`, so names have no slash in front.
    return spec.topic.removeprefix("/")


def _camera(spec):
    return ros.Camera(
        _name(spec),
        spec.sensor,
        focal_px=spec.focal_px or None,
        rgb="rgb" in spec.outputs,
        depth="depth" in spec.outputs,
        imu=bool(spec.imu),
        frame_id=spec.frame_id,
        event_ids=spec.with_ids,
    )


def _instances(feed):
    """What the ids of a feed are."""
    return {number: ros.Instance(told["prim"], told["semantics"]) for number, told in feed.instances.items()}


def _status(camera):
    """Counts and light of a camera, and what a user should look into."""
    values = {"synthesis": camera.synthesis, **camera.statistics}
    for light in camera.light:
        values |= light or {}
    warnings = [warning for warning in camera.pose_warnings if warning]
    return values, warnings + [warning for own in camera.light_warnings for warning in own]


class Sink:
    """Publishes a feed's events and images. It is called while the renderer's memory is still valid.

    If `esaac:outputs` has `event_ids`, it publishes what each event shows, and the table of ids whenever a prim is
    new in it.
    """

    name = "publisher"

    def __init__(self, publisher, spec, log):
        self._publisher, self._name, self._log = publisher, _name(spec), log
        self._with_depth = "depth" in spec.outputs
        self._imu = Imu(spec.imu) if spec.imu else None
        self._with_ids, self._instances = spec.with_ids, 0
        self._status_s = -STATUS_S

    def __call__(self, feed, packet):
        frame = feed.frame
        aps = feed.camera.aps
        depth = frame.depth if self._with_depth else None
        samples = self._imu.samples() if self._imu else ()
        # The first frame ends no interval, so it has no events to publish.
        packet = packet if feed.frames > 1 else None
        ids = feed.forms["event_ids"] if self._with_ids and packet is not None else None
        # Prims are added to the table, and none is taken out or changed.
        if self._instances != len(feed.instances):
            self._publisher.set_instances(self._name, _instances(feed))
            self._instances = len(feed.instances)
        self._publisher.publish(
            frame.t_ns,
            {self._name: ros.Frame(packet, aps=aps, rgb=frame.rgb, depth=depth, imu=samples, ids=ids)},
        )
        for notice in self._publisher.notices():
            self._log.warn(notice)
        now_s = time.monotonic()
        if now_s - self._status_s >= STATUS_S:
            self._status_s = now_s
            self._publisher.set_status(self._name, *_status(feed.camera))

    def restart(self):
        """Tells subscribers that time has gone back."""
        self._publisher.restart()

    def changed(self, sensor):
        self._publisher.set_sensor(self._name, sensor)
