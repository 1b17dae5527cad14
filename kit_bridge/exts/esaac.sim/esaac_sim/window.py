"""The window: cameras, live images, rates, latency, memory, problems, and the sensors' parameters."""

import omni.kit.app
import omni.ui as ui

import esaac

from .live_image import LiveImage

CONTROLS = {
    "contrast_on": (0.02, 1.0),
    "contrast_off": (0.02, 1.0),
    "contrast_mismatch": (0.0, 0.1),
    "refractory_ns": (0, 2_000_000),
    "leak_rate_hz": (0.0, 5.0),
    "shot_noise_rate_hz": (0.0, 20.0),
    "latency_ns": (0, 1_000_000),
    "latency_jitter_ns": (0, 100_000),
    "exposure_gain": (0.01, 100.0),
    "substeps": (1, 64),
}
"""Parameters that can be changed while a camera runs, and their ranges."""

IMAGE_EVERY = 4
"""A picture is drawn at every so many updates of the window."""


class Window:
    """Shows the cameras of a bridge."""

    def __init__(self, title, bridge, attach, detach):
        self._bridge, self._shown = bridge, []
        self._rows, self._updates = [], 0
        self._window = ui.Window(title, width=460, height=640)
        with self._window.frame, ui.VStack(spacing=6):
            with ui.HStack(height=28, spacing=6):
                ui.Button("Attach", clicked_fn=attach)
                ui.Button("Detach", clicked_fn=detach)
                ui.Button("Save again", clicked_fn=bridge.save_unsaved)
            self._problems = ui.Label("", word_wrap=True, height=0, style={"color": 0xFF4040E0})
            self._checks = ui.Label("", word_wrap=True, height=0)
            self._list = ui.ScrollingFrame()
        stream = omni.kit.app.get_app().get_update_event_stream()
        self._subscription = stream.create_subscription_to_pop(self._update, name="esaac.sim window")

    @property
    def visible(self):
        return self._window.visible

    @visible.setter
    def visible(self, visible):
        self._window.visible = visible

    def destroy(self):
        self._subscription = None
        for feed, _, image, _ in self._rows:
            if image in feed.sinks:
                feed.sinks.remove(image)
        self._window.destroy()

    def _update(self, _event):
        if not self._window.visible:
            return
        feeds = self._bridge.feeds
        if self._shown != feeds:
            self._build(feeds)
        unsaved = [f"not saved: {len(r)} events of {r.path}" for r in self._bridge.unsaved]
        self._problems.text = "\n".join(self._bridge.problems + unsaved)
        self._checks.text = "\n".join(
            f"self-test, {check.name}: {'ok' if check.holds else 'FAILED'}, {check.message}"
            for check in self._bridge.checks
        )
        self._updates += 1
        for feed, label, image, provider in self._rows:
            label.text = describe(feed)
            if self._updates % IMAGE_EVERY == 0:
                rgba = image.rgba
                provider.set_bytes_data(rgba.ravel().tolist(), [rgba.shape[1], rgba.shape[0]])

    def _build(self, feeds):
        self._shown = list(feeds)
        self._rows = []
        self._list.clear()
        with self._list, ui.VStack(spacing=8, height=0):
            for feed in feeds:
                sensor = feed.spec.sensor
                image = LiveImage(sensor.width, sensor.height, lambda: self._window.visible)
                feed.sinks.append(image)
                with ui.CollapsableFrame(feed.spec.path, height=0), ui.VStack(spacing=4, height=0):
                    label = ui.Label("", word_wrap=True, height=0)
                    provider = ui.ByteImageProvider()
                    ui.ImageWithProvider(provider, height=220)
                    for name in CONTROLS:
                        self._control(feed, name)
                self._rows.append((feed, label, image, provider))

    def _control(self, feed, name):
        low, high = CONTROLS[name]
        value = getattr(feed.camera.sensor, name)
        with ui.HStack(height=20):
            ui.Label(name, width=150)
            slider = (ui.IntSlider if isinstance(value, int) else ui.FloatSlider)(min=low, max=high)
        slider.model.set_value(value)

        def changed(model):
            chosen = model.get_value_as_int() if isinstance(value, int) else model.get_value_as_float()
            try:
                feed.change(**{name: chosen})
            except esaac.EsaacError as error:
                feed.message = str(error)

        slider.model.add_end_edit_fn(changed)


def describe(feed):
    """A camera in words."""
    sensor, (frames_hz, events_hz) = feed.spec.sensor, feed.rates
    lost = {
        "repeated": feed.duplicates,
        "gaps": feed.gaps,
        "unusable": feed.unusable,
        "faults": feed.faults,
        "dropped events": feed.dropped,
    }
    text = (
        f"{feed.message}\n{sensor.name} {sensor.width}x{sensor.height}, {frames_hz:.0f} frames/s, "
        f"{events_hz / 1e6:.2f} Mev/s, step {feed.latency_ms:.2f} ms, {feed.memory_bytes / 1e6:.1f} MB\n"
        + ", ".join(f"{count} {name}" for name, count in lost.items())
    )
    return "\n".join([text, *feed.light])
