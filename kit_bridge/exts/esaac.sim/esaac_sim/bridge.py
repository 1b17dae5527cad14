"""The event cameras of a stage: finds them, feeds them frames and hands their events on."""

import esaac

from . import exposure, poses, publishing, schema, self_test, sinks, ticks, writer
from .closing import CloseError, Closing
from .feed import Feed
from .frames import FrameUnusable
from .texture import Texture
from .timeline import TimelineStopped

SETTINGS = "/exts/esaac.sim/"


class Bridge:
    """Event cameras of one stage.

    `stage` is the one whose cameras are attached, or None. `problems` says in words what went wrong. `unsaved` holds
    recorders whose files could not be written, with all their events: see `save_unsaved`.
    """

    def __init__(self, settings, log):
        self.settings, self.log = settings, log
        self.feeds, self.problems, self.checks = [], [], []
        self.unsaved = []
        self._attached, self._before, self._publisher = [], None, None
        self._transforms = self._every_frame = None
        self._tested_geometry = False
        self._claimed = set()
        self.stage = None

    def setting(self, name, default):
        value = self.settings.get(SETTINGS + name)
        return default if value is None else value

    @property
    def attached(self):
        return bool(self._attached)

    async def self_test(self, app, stage):
        """Checks what the renderer draws; plays the timeline for that. Once, and once more when a camera first needs
        depth and ids. False if somebody stopped the timeline meanwhile: then the next call tests again."""
        with_geometry = any(spec.with_geometry for spec in schema.cameras(stage)[0])
        tested = self.checks and self._tested_geometry >= with_geometry
        if tested or not self.setting("self_test", True):
            return True
        before = exposure.pin(self.settings)
        try:
            device = self.setting("device", None) or None
            self.checks = await self_test.run(app, stage, self.wants_texture, device, with_geometry)
        except TimelineStopped as stopped:
            self.log.warn(f"self-test given up: {stopped}")
            return False
        except Exception as error:  # A renderer that cannot draw the test must not keep cameras from running.
            failed = f"{type(error).__name__}: {error}"
            self.checks = [self_test.Check("self-test", False, failed, disables="texture")]
        finally:
            exposure.restore(self.settings, before)
        self._tested_geometry = with_geometry
        for check in self.checks:
            (self.log.info if check.holds else self.log.warn)(f"self-test, {check.name}: {check.message}")
        return True

    def attach(self, stage):
        """Makes an event camera of each camera that asks for it."""
        lost = []
        try:
            self.detach()
        except CloseError as error:
            lost = _words(error)
        self.stage = stage
        specs, problems = schema.cameras(stage)
        self.problems = lost + problems
        off = self_test.disabled(self.checks)
        self._before = exposure.pin(self.settings)
        self._every_frame = ticks.EveryFrame(stage, [spec.path for spec in specs])
        self._open_publisher([spec for spec in specs if spec.publish], off)
        for spec in specs:
            try:
                self._attach(self._with_poses(spec), off)
            except (esaac.EsaacError, FrameUnusable, poses.PosesUnusable, OSError) as error:
                self.problems.append(f"{spec.path}: {error}")
        for problem in self.problems:
            self.log.error(problem)
        return len(self.feeds)

    def _with_poses(self, spec):
        """The camera as it is fed; poses are recorded from now on if it wants some."""
        spec, self._transforms, why = poses.recorded(spec, self.stage, self._transforms)
        if why:
            self.problems.append(f"{spec.path}: {why}, so mode `auto` does without poses")
        return spec

    def _attach(self, spec, off):
        if "everything" in off:
            raise esaac.DeviceError("the self-test saw no frames that can be read; no camera is attached")
        if "rate" in off and spec.tick_rate_hz:
            raise esaac.DeviceError(
                f"{ticks.ATTRIBUTE} is {spec.tick_rate_hz:g}, and the self-test saw that the renderer keeps to it, "
                "so images may be old ones; set it to 0"
            )
        if "geometry" in off and spec.with_geometry:
            failed = "the renderer's depth or instance ids failed the self-test"
            if spec.needs_poses:
                raise esaac.DeviceError(f"{failed}, and {spec.needing_poses} needs them")
            self.problems.append(f"{spec.path}: {failed}, so mode `auto` does without poses")
            spec = _replaced(spec, with_geometry=False)
        if "motion" in off and spec.sensor.synthesis in ("motion", "paper"):
            self.problems.append(
                f"{spec.path}: the renderer's motion vectors failed the self-test, so mode `linear` is used"
            )
            linear = spec.sensor.replace(synthesis="linear")
            spec = _replaced(spec, sensor=linear, with_motion=False)
        if "motion" in off and spec.with_motion:
            self.problems.append(
                f"{spec.path}: the renderer's motion vectors failed the self-test, so what has no poses is blended"
            )
            spec = _replaced(spec, with_motion=False)
        if "light" in off:
            self.problems.append(
                f"{spec.path}: the renderer's light failed the self-test, expected HdrColor to be linear, so events "
                "have the wrong contrast; switch off what curves it, such as tone mapping or exposure"
            )
        by_texture = self._by_texture(spec, off)
        transforms = self._transforms if spec.with_geometry else None
        feed = Feed(spec, device=self.setting("device", None) or None, transforms=transforms)
        drawn = None
        try:
            self._add_sinks(feed)
            drawn = writer.attach(spec, feed.write, with_hdr=not by_texture)
            if by_texture:
                feed.texture = Texture(drawn[0], feed.camera)
        except BaseException:
            closing = Closing()
            if drawn is not None:
                closing.call(writer.detach, *drawn)
            closing.call(feed.close)
            try:
                closing.finish()
            except CloseError as error:
                self.problems += _words(error)
            raise
        self.feeds.append(feed)
        self._attached.append(drawn)

    @property
    def wants_texture(self):
        """Whether the texture path may be tried at all: see `texture.py`."""
        return self.setting("path", "annotator") == "texture"

    def _by_texture(self, spec, off):
        if not self.wants_texture:
            return False
        passed = any(check.name == "texture" and check.holds for check in self.checks)
        if not passed or "texture" in off:
            self.problems.append(
                f"{spec.path}: the texture path has not passed the self-test, so the annotator's array is used"
            )
            return False
        return True

    def _open_publisher(self, specs, off):
        """One for all cameras: they share a clock, and a process has one transport a domain."""
        if not specs:
            return
        paths = ", ".join(spec.path for spec in specs)
        if "publish" in off:
            self.problems.append(
                f"{paths}: the renderer's clock failed the self-test, so nothing is published"
            )
            return
        try:
            self._publisher = publishing.publisher(specs)
        except esaac.EsaacError as error:
            self.problems.append(
                f"{paths}: nothing is published: {error}; events are still recorded and shown"
            )

    def _add_sinks(self, feed):
        spec = feed.spec
        folder = self.setting("record", "")
        if folder:
            feed.sinks.append(sinks.Recorder(folder, spec, claimed=self._claimed, log=self.log))
        if spec.publish and self._publisher:
            feed.sinks.append(publishing.Sink(self._publisher, spec, self.log))

    @property
    def publisher(self):
        """What publishes to ROS 2, if anything is published."""
        return self._publisher

    def detach(self):
        """Closes everything, each part even if another fails; then raises `CloseError` with all errors."""
        closing = Closing()
        for product, attached in self._attached:
            closing.call(writer.detach, product, attached)
        for feed in self.feeds:
            closing.call(feed.close)
            self.unsaved += [sink for sink in feed.sinks if isinstance(sink, sinks.Recorder)]
        if self._publisher is not None:
            closing.call(self._publisher.close)
        if self._transforms is not None:
            closing.call(self._transforms.close)
        if self._every_frame is not None:
            closing.call(self._every_frame.restore)
        if self._before is not None:
            closing.call(exposure.restore, self.settings, self._before)
        self.feeds, self._attached, self._before, self._publisher = [], [], None, None
        self._transforms = self._every_frame = self.stage = None
        closing.finish()

    def detach_and_tell(self):
        """As `detach`, for callers to whom nobody listens: errors are logged and become problems."""
        try:
            self.detach()
        except CloseError as error:
            self.tell(_words(error))

    def save_unsaved(self):
        """Writes the recordings that failed once more, to the folder that is set now. Returns how many are left."""
        folder, closing = self.setting("record", "") or None, Closing()
        self.unsaved = [recorder for recorder in self.unsaved if not closing.call(recorder.close, folder)]
        try:
            closing.finish()
        except CloseError as error:
            self.tell(_words(error))
        return len(self.unsaved)

    def tell(self, problems):
        """Adds problems and logs them."""
        self.problems += problems
        for problem in problems:
            self.log.error(problem)


def _words(error):
    return [f"{type(each).__name__}: {each}" for each in error.exceptions]


def _replaced(spec, **changes):
    import dataclasses

    return dataclasses.replace(spec, **changes)
