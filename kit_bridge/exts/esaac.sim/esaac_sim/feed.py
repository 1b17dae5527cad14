"""One camera of the stage: its render product's frames in, its events to whoever wants them."""

import collections
import time

import esaac

from .frames import FrameUnusable, frame_of

LONGEST_GAP_NS = 1_000_000_000
RATE_WINDOW = 60

FORMS = {
    "event_frame": lambda camera: camera.event_frame(),
    "voxel_grid": lambda camera: camera.voxel_grid(),
    "aps": lambda camera: camera.aps,
}
"""What `esaac:outputs` may ask for beside the events."""


class Feed:
    """Steps an event camera with a writer's data, and keeps count."""

    def __init__(self, spec, device=None):
        self.spec = spec
        self.texture = None
        self.camera = esaac.EventCamera(spec.sensor, device=device, packets=spec.packets)
        self.sinks = []
        self.frames = self.events = self.dropped = 0
        self.duplicates = self.gaps = self.unusable = self.faults = 0
        self.message = "waiting for the first frame"
        self.packet = None
        self.frame = None
        self.forms = {}
        self.latency_ms = 0.0
        self._last_ns = None
        self._recent = collections.deque(maxlen=RATE_WINDOW)

    def write(self, data):
        """What the writer calls: on the thread of the renderer, with memory that is the renderer's until this
        returns. `step` returns when the engine has read it."""
        sensor = self.spec.sensor
        try:
            needs_motion = sensor.synthesis in ("motion", "paper")
            frame = frame_of(data, sensor.width, sensor.height, needs_motion, self.spec.outputs, self.texture)
        except FrameUnusable as unusable:
            self.unusable += 1
            self.message = str(unusable)
            return
        if self._last_ns is not None:
            if frame.t_ns == self._last_ns:
                # Replicator hands out a frame again where rates differ; it holds nothing new.
                self.duplicates += 1
                return
            if frame.t_ns < self._last_ns or frame.t_ns - self._last_ns > LONGEST_GAP_NS:
                # The timeline was stopped, or rewound.
                self.gaps += 1
                self.camera.reset()
                self._tell("restart")
        started = time.perf_counter()
        try:
            packet = self.camera.step(frame.hdr, frame.motion, t_ns=frame.t_ns)
        except esaac.EsaacError as error:
            self.faults += 1
            self.message = f"{type(error).__name__}: {error}"
            return
        self.latency_ms = 1e3 * (time.perf_counter() - started)
        self._last_ns = frame.t_ns
        self.frames += 1
        self.events += len(packet)
        self.dropped += packet.dropped
        self.packet = packet
        self.forms = {name: form(self.camera) for name, form in FORMS.items() if name in self.spec.outputs}
        self.message = "running"
        self._recent.append((started, len(packet)))
        self.frame = frame
        for sink in self.sinks:
            try:
                sink(self, packet)
            except Exception as error:  # A sink is others' code: its fault is shown and ends nothing.
                self.faults += 1
                self.message = f"{getattr(sink, 'name', sink)}: {error}"
        # The renderer's memory is its own again.
        self.frame = None

    def _tell(self, what, *arguments):
        for sink in self.sinks:
            told = getattr(sink, what, None)
            if told:
                told(*arguments)

    @property
    def rates(self):
        """Frames and events a second of wall time, of late."""
        if len(self._recent) < 2:
            return 0.0, 0.0
        span = self._recent[-1][0] - self._recent[0][0]
        events = sum(count for _, count in list(self._recent)[1:])
        return ((len(self._recent) - 1) / span, events / span) if span > 0 else (0.0, 0.0)

    @property
    def memory_bytes(self):
        return sum(use["bytes"] for use in self.camera.memory())

    def change(self, **parameters):
        """Changes the sensor while it runs; a wrong value raises `esaac.SensorError` and changes nothing."""
        self.camera.sensor = self.camera.sensor.replace(**parameters)
        self._tell("changed", self.camera.sensor)

    def close(self):
        self._tell("close")
        self.sinks = []
        self.camera.close()
