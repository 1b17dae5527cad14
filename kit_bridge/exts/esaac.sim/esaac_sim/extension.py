"""The part that Kit starts: a menu entry, a window, and cameras that attach on play and detach on stop."""

import asyncio

import carb
import carb.settings
import omni.ext
import omni.kit.app
import omni.kit.menu.utils
import omni.timeline
import omni.usd
from omni.kit.menu.utils import MenuItemDescription

from .bridge import SETTINGS, Bridge
from .schema import register
from .window import Window

MENU = "Window"
TITLE = "Event cameras"


class Log:
    """Kit's log under the extension's name."""

    def info(self, message):
        carb.log_info(f"[esaac.sim] {message}")

    def warn(self, message):
        carb.log_warn(f"[esaac.sim] {message}")

    def error(self, message):
        carb.log_error(f"[esaac.sim] {message}")


class Extension(omni.ext.IExt):
    """`esaac.sim`."""

    def on_startup(self, ext_id):
        register()
        self.bridge = Bridge(carb.settings.get_settings(), Log())
        self.window = None
        self._task = None
        self._menu = [MenuItemDescription(name=TITLE, glyph="eye.svg", onclick_fn=self.show)]
        omni.kit.menu.utils.add_menu_items(self._menu, MENU)
        stream = omni.timeline.get_timeline_interface().get_timeline_event_stream()
        self._timeline = stream.create_subscription_to_pop(self._on_timeline, name="esaac.sim")
        stream = omni.usd.get_context().get_stage_event_stream()
        self._stage = stream.create_subscription_to_pop(self._on_stage, name="esaac.sim")

    def on_shutdown(self):
        omni.kit.menu.utils.remove_menu_items(self._menu, MENU)
        self._timeline = self._stage = None
        if self._task:
            self._task.cancel()
        if self.window:
            self.window.destroy()
            self.window = None
        self.bridge.detach_and_tell()

    def show(self, *_):
        """Opens the window."""
        if self.window is None:
            self.window = Window(TITLE, self.bridge, self.attach, self.bridge.detach_and_tell)
        self.window.visible = True

    def attach(self):
        """Runs the self-test, once, then attaches every event camera of the stage."""
        if self._task is None or self._task.done():
            self._task = asyncio.ensure_future(self._attach())
        return self._task

    async def _attach(self):
        stage = omni.usd.get_context().get_stage()
        if stage is None:
            return 0
        try:
            if not await self.bridge.self_test(omni.kit.app.get_app(), stage):
                return 0
            return self.bridge.attach(stage)
        except Exception as error:  # Nobody waits for the task, so its error would be lost.
            self.bridge.detach_and_tell()
            self.bridge.tell([f"cameras are not attached: {type(error).__name__}: {error}"])
            return 0

    def _on_timeline(self, event):
        kind = omni.timeline.TimelineEventType(event.type)
        if kind == omni.timeline.TimelineEventType.PLAY:
            if self.bridge.stage not in (None, omni.usd.get_context().get_stage()):
                self._leave_stage()
            if self.bridge.setting("attach_on_play", True) and not self.bridge.attached:
                self.attach()
        elif kind == omni.timeline.TimelineEventType.STOP:
            # Detaching writes the recordings.
            self.bridge.detach_and_tell()

    def _on_stage(self, event):
        if event.type == int(omni.usd.StageEventType.CLOSING):
            if self._task:
                self._task.cancel()
            if self.bridge.stage is not None:
                self._leave_stage()

    def _leave_stage(self):
        self.bridge.detach_and_tell()
        self.bridge.tell(
            ["the stage was closed, so its cameras are detached; press play to attach those of the next"]
        )


__all__ = ["MENU", "SETTINGS", "TITLE", "Extension"]
