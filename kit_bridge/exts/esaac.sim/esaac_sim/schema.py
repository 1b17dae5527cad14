"""Reads the `esaac:*` attributes: which cameras of a stage are event cameras, and with which parameters.

The applied schema `EsaacEventCameraAPI` (`schema/generatedSchema.usda`) declares them. They work without the schema
too, so a stage needs no plug-in to have them.
"""

import dataclasses
import pathlib

from pxr import Plug, Usd, UsdGeom

import esaac
import esaac.ros

from . import ticks

API = "EsaacEventCameraAPI"
PREFIX = "esaac:"
OUTPUTS = ("events", "event_ids", "event_frame", "voxel_grid", "aps", "rgb", "depth")

_DEFAULTS = {
    "enabled": True,
    "sensor": "davis346",
    "profile": "clean",
    "overrides": "",
    "substeps": 32,
    "mode": "auto",
    "outputs": ("events",),
    "packets": "host",
    "publish": False,
    "topic": "",
    "frameId": "",
    "imu": "",
}


class SchemaError(ValueError):
    """An `esaac:*` attribute is wrong; the message names prim and attribute."""


@dataclasses.dataclass(frozen=True)
class CameraSpec:
    """The attributes of one camera prim, checked."""

    path: str
    sensor: esaac.SensorModel
    outputs: tuple
    packets: str
    publish: bool
    topic: str
    """Prefix of its topics `events`, `aps/image_raw` and so on."""
    frame_id: str | None
    imu: str
    """Path of an IMU sensor that is published with it, or empty."""
    focal_px: float
    with_motion: bool
    """Whether motion vectors are asked of the renderer."""
    with_geometry: bool
    """Whether depth and instance ids are asked of it, and poses recorded."""
    tick_rate_hz: float
    """How often the stage says that it is drawn; 0 is every frame."""

    @property
    def with_ids(self):
        """Whether each event is labelled with the id of what it shows."""
        return "event_ids" in self.outputs

    @property
    def needs_poses(self):
        """Whether it sends no events without poses. Else mode `auto` does without them."""
        return self.sensor.synthesis == "rigid" or self.with_ids

    @property
    def needing_poses(self):
        """What of such a camera needs poses, as messages call it."""
        return "`event_ids` of esaac:outputs" if self.with_ids else "mode `rigid`"

    @property
    def intrinsics(self):
        """Its lens; the centre of the first pixel is half a pixel from the corner."""
        middle = self.sensor.width / 2, self.sensor.height / 2
        return esaac.Intrinsics(self.focal_px, self.focal_px, *middle, half_pixel_centres=True)


def register():
    """Registers the applied schema with USD. Calling it again does no harm."""
    Plug.Registry().RegisterPlugins(str(pathlib.Path(__file__).parents[1] / "schema"))


def is_event_camera(prim):
    """Whether a camera has the schema or any of its attributes, and is not switched off."""
    if not prim.IsA(UsdGeom.Camera):
        return False
    carried = prim.HasAPI(API) if Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(API) else False
    names = [a.GetName() for a in prim.GetAuthoredAttributes() if a.GetName().startswith(PREFIX)]
    return (carried or API in prim.GetAppliedSchemas() or bool(names)) and bool(_value(prim, "enabled"))


def cameras(stage):
    """A `CameraSpec` for each valid event camera, in the stage's order, and the errors of the others."""
    specs, errors = [], []
    for prim in stage.Traverse():
        if is_event_camera(prim):
            try:
                specs.append(spec_of(prim))
            except SchemaError as error:
                errors.append(str(error))
    return specs, errors


def spec_of(prim):
    """Reads a prim's attributes."""
    path = str(prim.GetPath())
    unknown = [
        a.GetName()
        for a in prim.GetAuthoredAttributes()
        if a.GetName().startswith(PREFIX) and a.GetName()[len(PREFIX) :] not in _DEFAULTS
    ]
    if unknown:
        expected = ", ".join(PREFIX + name for name in _DEFAULTS)
        raise SchemaError(f"{path}: unknown attribute {unknown[0]}, expected one of {expected}")
    outputs = tuple(str(output) for output in _value(prim, "outputs"))
    for output in outputs:
        if output not in OUTPUTS:
            raise SchemaError(f"{path}.esaac:outputs has `{output}`, expected {', '.join(OUTPUTS)}")
    packets = str(_value(prim, "packets"))
    if packets not in ("host", "cuda"):
        raise SchemaError(f"{path}.esaac:packets is `{packets}`, expected host or cuda")
    # The topic of the events stands for the camera's.
    topic = (str(_value(prim, "topic")) or "/" + prim.GetName().lower()).removesuffix("/events")
    frame_id = str(_value(prim, "frameId")) or None
    publish = bool(_value(prim, "publish"))
    if publish:
        try:
            esaac.ros.check_names(topic, frame_id)
        except esaac.ArgumentError as error:
            raise SchemaError(f"{path}: {error}") from error
    sensor = _sensor(prim, path, outputs)
    focal_px = _focal_px(prim, sensor.width)
    if "event_ids" in outputs and sensor.synthesis not in ("rigid", "auto"):
        raise SchemaError(
            f"{path}.esaac:outputs has `event_ids`, which needs mode `rigid` or `auto`, but the mode is "
            f"`{sensor.synthesis}`"
        )
    spec = CameraSpec(
        path=path,
        sensor=sensor,
        outputs=outputs,
        packets=packets,
        publish=publish,
        topic=topic,
        frame_id=frame_id,
        imu=str(_value(prim, "imu")),
        focal_px=focal_px,
        with_motion=sensor.synthesis in ("motion", "paper", "auto"),
        # Without a lens `auto` does without.
        with_geometry=sensor.synthesis in ("rigid", "auto") and focal_px > 0,
        tick_rate_hz=_tick_rate_hz(prim),
    )
    if spec.needs_poses and not focal_px:
        raise SchemaError(f"{path} has no horizontal aperture, which {spec.needing_poses} needs")
    return spec


def _tick_rate_hz(prim):
    attribute = prim.GetAttribute(ticks.ATTRIBUTE)
    return float((attribute.Get() if attribute else None) or 0)


def _focal_px(prim, width):
    """Pixels are square: renderers fit the aperture to the image by their widths."""
    camera = UsdGeom.Camera(prim)
    aperture = camera.GetHorizontalApertureAttr().Get()
    return camera.GetFocalLengthAttr().Get() / aperture * width if aperture else 0.0


def _sensor(prim, path, outputs):
    substeps = _value(prim, "substeps")
    try:
        parameters = {"substeps": int(substeps), "synthesis": str(_value(prim, "mode"))}
    except (TypeError, ValueError):
        raise SchemaError(f"{path}.esaac:substeps is `{substeps}`, expected a whole number") from None
    if "aps" in outputs:
        # Half of a frame at 60 Hz, unless the overrides say otherwise.
        parameters["aps_exposure_ns"] = 8_000_000
    sensor, profile = str(_value(prim, "sensor")), str(_value(prim, "profile"))
    if profile == "paper":
        parameters["synthesis"] = "paper"
    try:
        parameters.update(_overrides(str(_value(prim, "overrides"))))
        return esaac.SensorModel(sensor, profile=profile, **parameters)
    except (esaac.SensorError, ValueError) as error:
        raise SchemaError(f"{path}: {error}") from error


def _overrides(text):
    """Lines of `name = value`. Kit's oldest Python has no TOML reader, and parameters need no more than this."""
    values = {}
    for number, line in enumerate(text.splitlines(), 1):
        line = line.split("#", 1)[0].strip()
        if not line:
            continue
        name, equals, value = (part.strip() for part in line.partition("="))
        if not equals or not value:
            raise ValueError(f"esaac:overrides, line {number}: `{line}`, expected `name = value`")
        values[name] = value.strip("\"'")
    return values


def _value(prim, name):
    attribute = prim.GetAttribute(PREFIX + name)
    value = attribute.Get() if attribute else None
    return _DEFAULTS[name] if value is None else value
