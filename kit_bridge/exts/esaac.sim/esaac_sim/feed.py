"""One camera of the stage: takes the frames of its render product and hands the events to its sinks."""

import collections
import threading
import time

import esaac

from .closing import Closing
from .frames import FrameUnusable, frame_of

LONGEST_GAP_NS = 1_000_000_000
RATE_WINDOW = 60
FRAMES_WITHOUT_POSES = 10
"""So many frames mode `auto` waits for the first physics step."""

FORMS = {
    "event_ids": lambda camera: camera.event_ids(),
    "event_frame": lambda camera: camera.event_frame(),
    "voxel_grid": lambda camera: camera.voxel_grid(),
    "aps": lambda camera: camera.aps,
}
"""What `esaac:outputs` may ask for besides the events."""


class Feed:
    """Steps an event camera with a writer's data, and counts frames, events and faults.

    `packet` and `forms` are those of the last frame. `instances` says what the ids of `forms["event_ids"]` are:
    `{7: {"prim": "/cube", "semantics": {"class": ["box"]}}}`. An id means the same prim as long as the feed lives.
    """

    def __init__(self, spec, device=None, transforms=None):
        self.spec = spec
        self.texture = None
        self.camera = esaac.EventCamera(
            spec.sensor,
            intrinsics=spec.intrinsics if transforms else None,
            device=device,
            packets=spec.packets,
        )
        self._transforms = transforms
        self._recorder = transforms.recorder(spec.path) if transforms else None
        self.sinks = []
        self.frames = self.events = self.dropped = 0
        self.duplicates = self.gaps = self.unusable = self.faults = 0
        self.message = "waiting for the first frame"
        self._without_poses = 0
        self.packet = None
        self.frame = None
        self.forms, self.instances = {}, {}
        self._labels = {}
        # The renderer's thread steps the camera; the window changes its sensor.
        self._lock = threading.RLock()
        self.latency_ms = 0.0
        self._last_ns = None
        self._recent = collections.deque(maxlen=RATE_WINDOW)

    def write(self, data):
        """The writer calls this on the renderer's thread. The arrays are valid until it returns; `step` has read them
        by then."""
        with self._lock:
            self._write(data)

    def _write(self, data):
        spec, sensor = self.spec, self.spec.sensor
        try:
            frame = frame_of(
                data,
                *(
                    sensor.width,
                    sensor.height,
                    spec.with_motion,
                    spec.outputs,
                    self.texture,
                    spec.with_geometry,
                ),
            )
        except FrameUnusable as unusable:
            self.unusable += 1
            self.message = str(unusable)
            return
        if self._last_ns is not None:
            if frame.t_ns == self._last_ns:
                # Replicator hands out a frame twice if rates differ. It holds nothing new.
                self.duplicates += 1
                return
            if frame.t_ns < self._last_ns or frame.t_ns - self._last_ns > LONGEST_GAP_NS:
                # The timeline was stopped, or rewound.
                self.gaps += 1
                self.camera.reset()
                self._last_ns = None
                self._tell("restart")
        started = time.perf_counter()
        try:
            packet = self._step(frame)
            forms = {name: form(self.camera) for name, form in FORMS.items() if name in spec.outputs}
        except FrameUnusable as unusable:
            self.unusable += 1
            self.message = str(unusable)
            return
        except esaac.EsaacError as error:
            self.faults += 1
            self.message = f"{type(error).__name__}: {error}"
            return
        self.latency_ms = 1e3 * (time.perf_counter() - started)
        self._last_ns = frame.t_ns
        self.frames += 1
        self.events += len(packet)
        self.dropped += packet.dropped
        self.packet, self.forms = packet, forms
        self._labels = frame.labels
        self.message = self._warning() or "running"
        self._recent.append((started, len(packet)))
        self.frame = frame
        for sink in self.sinks:
            self._guarded(sink, sink, self, packet)
        # The renderer may overwrite its memory from now on.
        self.frame = None

    def _step(self, frame):
        if self._recorder is not None:
            if not len(self._recorder) and not self._gives_up_poses():
                needing = "; `event_ids` of esaac:outputs needs them" if self.spec.with_ids else ""
                raise FrameUnusable(
                    f"no poses yet: physics has not stepped. Does the stage have a physics scene?{needing}"
                )
        if self._recorder is not None:
            since_ns = frame.t_ns if self._last_ns is None else self._last_ns
            frame.ids, frame.labels = self._transforms.instances.settle(frame.ids, frame.labels)
            self._describe(frame.labels)
            # Kit lists what a frame shows. Events come of the frame before as well.
            self._recorder.ids = self._transforms.table({**self._labels, **frame.labels}, since_ns)
        return self.camera.step(
            frame.hdr,
            frame.motion,
            t_ns=frame.t_ns,
            depth=frame.depth if self._recorder is not None else None,
            ids=frame.ids if self._recorder is not None else None,
            poses=self._recorder,
        )

    def _describe(self, labels):
        """Keeps what is new among the ids of a frame."""
        for number in labels.keys() - self.instances.keys() if self.spec.with_ids else ():
            if told := self._transforms.instances.described(number):
                self.instances[number] = told

    def _gives_up_poses(self):
        """Whether the camera goes on without poses: mode `auto`, if physics does not step."""
        self._without_poses += 1
        # The first frame that is stepped decides.
        undecided = self.camera.synthesis is None and not self.spec.needs_poses
        if undecided and self._without_poses > FRAMES_WITHOUT_POSES:
            self._recorder = None
        return self._recorder is None

    def _warning(self):
        """What is wrong with the poses: there are none, or the renderer's motion vectors say otherwise."""
        if self._recorder is None and self._transforms is not None:
            return f"no poses, as physics does not step; mode `auto` is `{self.camera.synthesis}`"
        return self.camera.pose_warnings[0] if self._recorder is not None and self.spec.with_motion else None

    def _tell(self, what, *arguments):
        for sink in self.sinks:
            self._guarded(sink, getattr(sink, what, None) or (lambda *_: None), *arguments)

    def _guarded(self, sink, call, *arguments):
        """A sink is others' code: its fault is shown, and everything else goes on."""
        try:
            call(*arguments)
        except Exception as error:
            self.faults += 1
            self.message = f"{getattr(sink, 'name', sink)}: {error}"

    @property
    def rates(self):
        """Frames and events per second of wall time, over the last frames."""
        if len(self._recent) < 2:
            return 0.0, 0.0
        span = self._recent[-1][0] - self._recent[0][0]
        events = sum(count for _, count in list(self._recent)[1:])
        return ((len(self._recent) - 1) / span, events / span) if span > 0 else (0.0, 0.0)

    @property
    def light(self):
        """Lines about the light: how much falls on physical pixels, and what is wrong with it."""
        lines = []
        for report in self.camera.light:
            if report:
                median, low, high = (f"{report[name]:.3g}" for name in ("median_lux", "low_lux", "high_lux"))
                lines.append(
                    f"light on the sensor {median} lux, nine tenths of the pixels {low} to {high} lux"
                )
        return lines + [f"light: {text}" for of_camera in self.camera.light_warnings for text in of_camera]

    @property
    def memory_bytes(self):
        return sum(use["bytes"] for use in self.camera.memory())

    def change(self, **parameters):
        """Changes the sensor while it runs; a wrong value raises `esaac.SensorError` and changes nothing."""
        with self._lock:
            self.camera.sensor = self.camera.sensor.replace(**parameters)
            self._tell("changed", self.camera.sensor)

    def close(self):
        """Closes the sinks and the camera, each of them even if another fails; then raises `CloseError`. Sinks that
        failed stay in `sinks`: they may hold events."""
        closing = Closing()
        self.sinks = [sink for sink in self.sinks if hasattr(sink, "close") and not closing.call(sink.close)]
        closing.call(self.camera.close)
        closing.finish()
