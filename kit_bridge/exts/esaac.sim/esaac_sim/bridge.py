"""The cameras of a stage, from the first frame to the last: finds them, feeds them, sends their events on."""

import esaac

from . import exposure, publishing, schema, self_test, sinks, writer
from .feed import Feed
from .frames import FrameUnusable
from .texture import Texture

SETTINGS = "/exts/esaac.sim/"


class Bridge:
    """Event cameras of one stage."""

    def __init__(self, settings, log):
        self.settings, self.log = settings, log
        self.feeds, self.problems, self.checks = [], [], []
        self._attached, self._before, self._publisher = [], None, None

    def setting(self, name, default):
        value = self.settings.get(SETTINGS + name)
        return default if value is None else value

    @property
    def attached(self):
        return bool(self._attached)

    async def self_test(self, app, stage):
        """Asks the renderer what it draws, once."""
        if self.checks or not self.setting("self_test", True):
            return
        before = exposure.pin(self.settings)
        try:
            device = self.setting("device", None) or None
            self.checks = await self_test.run(app, stage, self.wants_texture, device)
        except Exception as error:  # A renderer that cannot draw the test must not keep cameras from running.
            failed = f"{type(error).__name__}: {error}"
            self.checks = [self_test.Check("self-test", False, failed, disables="texture")]
        finally:
            exposure.restore(self.settings, before)
        for check in self.checks:
            (self.log.info if check.holds else self.log.warn)(f"self-test, {check.name}: {check.message}")

    def attach(self, stage):
        """Makes an event camera of each camera that asks for it."""
        self.detach()
        specs, self.problems = schema.cameras(stage)
        off = self_test.disabled(self.checks)
        self._before = exposure.pin(self.settings)
        self._open_publisher([spec for spec in specs if spec.publish], off)
        for spec in specs:
            try:
                self._attach(spec, off)
            except (esaac.EsaacError, FrameUnusable, OSError) as error:
                self.problems.append(f"{spec.path}: {error}")
        for problem in self.problems:
            self.log.error(problem)
        return len(self.feeds)

    def _attach(self, spec, off):
        if "everything" in off:
            raise esaac.DeviceError("the self-test saw no frames that can be read; no camera is attached")
        if "motion" in off and spec.sensor.synthesis in ("motion", "paper"):
            self.problems.append(
                f"{spec.path}: the renderer's motion vectors failed the self-test, so mode `linear` is used"
            )
            spec = _replaced(spec, sensor=spec.sensor.replace(synthesis="linear"))
        by_texture = self._by_texture(spec, off)
        feed = Feed(spec, device=self.setting("device", None) or None)
        try:
            self._add_sinks(feed)
            product, attached = writer.attach(spec, feed.write, with_hdr=not by_texture)
            if by_texture:
                feed.texture = Texture(product)
        except BaseException:
            feed.close()
            raise
        self.feeds.append(feed)
        self._attached.append((product, attached))

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
            feed.sinks.append(sinks.Recorder(folder, spec))
        if spec.publish and self._publisher:
            feed.sinks.append(publishing.Sink(self._publisher, spec, self.log))

    @property
    def publisher(self):
        """What publishes to ROS 2, if anything is published."""
        return self._publisher

    def detach(self):
        """Gives everything back."""
        for product, attached in self._attached:
            writer.detach(product, attached)
        for feed in self.feeds:
            feed.close()
        if self._publisher is not None:
            try:
                self._publisher.close()
            except esaac.EsaacError as error:
                self.log.error(str(error))
        if self._before is not None:
            exposure.restore(self.settings, self._before)
        self.feeds, self._attached, self._before, self._publisher = [], [], None, None


def _replaced(spec, **changes):
    import dataclasses

    return dataclasses.replace(spec, **changes)
