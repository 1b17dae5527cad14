"""Events of what a script draws anyway with Isaac Sim 6's `isaacsim.sensors.experimental.rtx`.

    sensor = CameraSensor(RtxCamera("/World/eye"), resolution=(260, 346), render_vars=["HdrColor"])
    with events_of(sensor, stage) as feed:
        feed.sinks.append(lambda feed, packet: ...)
        ...                                             # play the timeline

The camera carries `esaac:*` attributes as any other. Do not attach it with a `Bridge` too: it would be drawn twice.
"""

import contextlib

import carb
import carb.settings

from . import exposure, schema, ticks, writer
from .feed import Feed
from .poses import recorded


@contextlib.contextmanager
def events_of(sensor, stage, device=None):
    """A `Feed` of a `CameraSensor`'s own render product, until the block ends. The sensor stays as it is.

    Modes `rigid` and `auto` record poses, and exposure is pinned, as for cameras that a `Bridge` attaches. The
    renderer is not tested. Raises `SchemaError` for wrong attributes and for a resolution that is not the sensor's.
    """
    (path,) = sensor.authoring_object.paths
    spec = schema.spec_of(stage.GetPrimAtPath(path))
    drawn, expected = tuple(sensor.resolution), (spec.sensor.height, spec.sensor.width)
    if drawn != expected:
        raise schema.SchemaError(
            f"{path} is drawn with the resolution (height, width) {drawn}, expected the sensor's {expected}"
        )
    settings = carb.settings.get_settings()
    with contextlib.ExitStack() as stack:
        stack.callback(exposure.restore, settings, exposure.pin(settings))
        stack.callback(ticks.EveryFrame(stage, [path]).restore)
        spec, transforms, why = recorded(spec, stage)
        if why:
            carb.log_warn(f"{path}: {why}, so mode `auto` does without poses")
        if transforms is not None:
            stack.callback(transforms.close)
        feed = Feed(spec, device=device, transforms=transforms)
        stack.callback(feed.close)
        stack.callback(writer.listen(spec, feed.write, str(sensor.render_product.GetPath())).detach)
        yield feed
