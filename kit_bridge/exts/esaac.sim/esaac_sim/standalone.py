"""How standalone scripts begin: a new stage, and a bridge that has tested the renderer."""

import asyncio

import carb.settings
import omni.kit.app
import omni.replicator.core as rep
import omni.usd

from .bridge import SETTINGS, Bridge
from .extension import Log


def begin(update, **chosen):
    """A bridge and its stage. The timeline is stopped: attach cameras, then play it. `update` is the application's;
    `chosen` are settings of the extension."""
    omni.usd.get_context().new_stage()
    stage = omni.usd.get_context().get_stage()
    settings = carb.settings.get_settings()
    # The script attaches when its cameras are there.
    for name, value in {"attach_on_play": False, **chosen}.items():
        settings.set(SETTINGS + name, value)
    rep.orchestrator.set_capture_on_play(True)
    bridge = Bridge(settings, Log())
    task = asyncio.ensure_future(bridge.self_test(omni.kit.app.get_app(), stage))
    while not task.done():
        update()
    task.result()
    return bridge, stage
