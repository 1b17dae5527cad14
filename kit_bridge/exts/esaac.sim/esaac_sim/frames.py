"""Reads an event camera's input out of a Replicator writer's data. Nothing is copied."""

import dataclasses

HDR = "HdrColor"
MOTION = "motion_vectors"
DEPTH = "distance_to_image_plane"
IDS = "instance_id_segmentation"
RGB = "rgb"
TIME = "IsaacReadSimulationTime"


class FrameUnusable(Exception):
    """A frame that cannot be used, and why. `expected`: the renderer has not drawn yet, as at the start of a run."""

    def __init__(self, message, expected=False):
        super().__init__(message)
        self.expected = expected


@dataclasses.dataclass
class Frame:
    hdr: object
    motion: object
    t_ns: int
    rgb: object = None
    depth: object = None
    ids: object = None
    labels: dict = dataclasses.field(default_factory=dict)
    """What each id is: the path of a prim, or a word."""


def find(data, name):
    """The entry of an annotator. Its key may end in a hyphen and the render product's name."""
    if name in data:
        return data[name]
    for key, value in data.items():
        if key.startswith(name + "-"):
            return value
    return None


def payload(entry):
    """The array of an entry. Some versions of Kit wrap it in `{"data": ..., "info": ...}`."""
    return entry["data"] if isinstance(entry, dict) and "data" in entry else entry


def seconds(entry):
    """Simulation time: a number, or a dict that holds one."""
    if isinstance(entry, dict):
        for key in ("simulationTime", "simulation_time", "data"):
            if key in entry:
                return seconds(entry[key])
        raise FrameUnusable(f"{TIME} has the keys {sorted(entry)}, expected `simulationTime`")
    if hasattr(entry, "item"):
        return float(entry.item())
    return float(entry)


def frame_of(data, width, height, needs_motion=True, outputs=(), texture=None, needs_geometry=False):
    """Colour, motion and time of a writer's data, checked, depth and ids if they are needed, and `rgb` and `depth` if
    `outputs` names them. Colour comes from the texture, if there is one."""
    hdr = texture.image(width, height) if texture else image_of(data, HDR, height, width)
    # Isaac Sim 6 leaves out the two channels that say nothing.
    motion = image_of(data, MOTION, height, width, channels=((4,), (2,))) if needs_motion else None
    rgb = image_of(data, RGB, height, width) if "rgb" in outputs else None
    wants_depth = needs_geometry or "depth" in outputs
    depth = image_of(data, DEPTH, height, width, channels=((),)) if wants_depth else None
    ids = _beside(image_of(data, IDS, height, width, channels=((),)), depth) if needs_geometry else None
    entry = find(data, TIME)
    if entry is None:
        raise FrameUnusable(f"no {TIME} among {sorted(data)}")
    t_ns, labels = round(seconds(entry) * 1e9), labels_of(data) if needs_geometry else {}
    return Frame(hdr=hdr, motion=motion, t_ns=t_ns, rgb=rgb, depth=depth, ids=ids, labels=labels)


def labels_of(data):
    """What each id of an image is."""
    entry = find(data, IDS)
    info = entry.get("info", {}) if isinstance(entry, dict) else {}
    if "idToLabels" not in info:
        raise FrameUnusable(f"{IDS} has no `idToLabels`: what its ids are is not known")
    return info["idToLabels"]


def _beside(array, other):
    """The array on the device of the other: Kit hands out segmentation on the host where it post-processes it."""
    if hasattr(array, "__cuda_array_interface__") or not hasattr(other, "__cuda_array_interface__"):
        return array
    import warp

    return warp.array(array, device=other.device)


def image_of(data, name, height, width, channels=((4,),)):
    """The array of an annotator, of this size and one of these numbers of channels."""
    array = payload(find(data, name))
    if array is None:
        raise FrameUnusable(f"no {name} among {sorted(data)}")
    shape = tuple(getattr(array, "shape", ()))
    if not shape or 0 in shape:
        raise FrameUnusable(f"{name} is empty: the renderer has not drawn yet", expected=True)
    allowed = [(height, width, *each) for each in channels]
    if shape not in allowed:
        # Kit drops axes of length 1, so an image of one row or column cannot be told from a list.
        raise FrameUnusable(f"{name} has shape {shape}, expected {' or '.join(map(str, allowed))}")
    return array
