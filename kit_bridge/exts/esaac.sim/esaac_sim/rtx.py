"""Events of what a script draws anyway with Isaac Sim 6's `isaacsim.sensors.experimental.rtx`.

    sensor = CameraSensor(RtxCamera("/World/eye"), resolution=(260, 346), render_vars=["HdrColor"])
    with events_of(sensor, stage) as feed:
        feed.sinks.append(lambda feed, packet: ...)
        ...                                             # play the timeline

The camera carries `esaac:*` attributes as any other. Do not attach it with a `Bridge` too: it would be drawn twice.
"""

import contextlib

from . import schema, ticks, writer
from .closing import Closing
from .feed import Feed


@contextlib.contextmanager
def events_of(sensor, stage, device=None):
    """A `Feed` of a `CameraSensor`'s own render product, until the block ends. The sensor stays as it is.

    Modes `rigid` and `auto` record poses, as of cameras that a `Bridge` attaches. Raises `SchemaError` for wrong
    attributes and for a resolution that is not the event sensor's.
    """
    (path,) = sensor.authoring_object.paths
    spec = schema.spec_of(stage.GetPrimAtPath(path))
    drawn, expected = tuple(sensor.resolution), (spec.sensor.height, spec.sensor.width)
    if drawn != expected:
        raise schema.SchemaError(
            f"{path} is drawn with the resolution (height, width) {drawn}, expected the sensor's {expected}"
        )
    closing, every_frame = Closing(), ticks.EveryFrame(stage, [path])
    transforms = feed = attached = None
    try:
        if spec.with_geometry:
            # Physics need not be there for other modes.
            from .poses import Transforms

            transforms = Transforms(stage)
        feed = Feed(spec, device=device, transforms=transforms)
        attached = writer.listen(spec, feed.write, str(sensor.render_product.GetPath()))
        yield feed
    finally:
        for close in (attached and attached.detach, feed and feed.close, transforms and transforms.close):
            if close:
                closing.call(close)
        closing.call(every_frame.restore)
        closing.finish()
