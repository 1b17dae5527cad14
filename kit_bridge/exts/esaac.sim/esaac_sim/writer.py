"""The Replicator writer that hands a render product's frames to a feed.

Polling annotators would drop or repeat frames if rates differ; a writer gets each frame once. Its arrays stay on the
device and are not copied: the engine has read them when `write` returns.
"""

import omni.replicator.core as rep

import esaac

from .frames import DEPTH, HDR, IDS, MOTION, RGB, TIME

NAME = "EsaacEventWriter"


class EsaacEventWriter(rep.Writer):
    """Calls `sink(data)` for each frame."""

    def __init__(
        self, sink, with_hdr=True, with_motion=True, with_rgb=False, with_depth=False, with_ids=False
    ):
        self.version = esaac.__version__
        self.sink = sink
        get = rep.AnnotatorRegistry.get_annotator
        names = [HDR] * with_hdr + [MOTION] * with_motion + [RGB] * with_rgb + [DEPTH] * with_depth
        self.annotators = [get(name, device="cuda", do_array_copy=False) for name in names]
        if with_ids:
            colours_off = {"colorize": False}
            self.annotators.append(get(IDS, init_params=colours_off, device="cuda", do_array_copy=False))
        # The time of the rendered frame. The simulation may be ahead of it.
        self.annotators.append(get(TIME, init_params={"resetOnStop": True}))

    def write(self, data):
        self.sink(data)


def attach(spec, sink, with_hdr=True):
    """Makes a render product of the camera's size and puts a writer on it. Give both to `detach`."""
    sensor = spec.sensor
    product = rep.create.render_product(spec.path, (sensor.width, sensor.height))
    return product, listen(spec, sink, product, with_hdr)


def listen(spec, sink, product, with_hdr=True):
    """Puts a writer on a render product, given as such or by its path. `detach` of the writer takes it off."""
    rep.WriterRegistry.register(EsaacEventWriter)
    writer = rep.writers.get(NAME)
    writer.initialize(
        sink=sink,
        with_hdr=with_hdr,
        with_motion=spec.with_motion,
        with_rgb="rgb" in spec.outputs,
        with_depth=spec.with_geometry or "depth" in spec.outputs,
        with_ids=spec.with_geometry,
    )
    writer.attach([product])
    return writer


def detach(product, writer):
    writer.detach()
    product.destroy()
