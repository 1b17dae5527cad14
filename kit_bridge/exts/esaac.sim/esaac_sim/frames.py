"""Reads an event camera's input out of a Replicator writer's data. Nothing is copied."""

import dataclasses

HDR = "HdrColor"
MOTION = "motion_vectors"
DEPTH = "distance_to_image_plane"
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


def frame_of(data, width, height, needs_motion=True, outputs=(), texture=None):
    """Colour, motion and time of a writer's data, checked, and `rgb` and `depth` if `outputs` names them. Colour
    comes from the texture, if there is one."""
    hdr = texture.image(width, height) if texture else _image(data, HDR, height, width)
    motion = _image(data, MOTION, height, width) if needs_motion else None
    rgb = _image(data, RGB, height, width) if "rgb" in outputs else None
    depth = _image(data, DEPTH, height, width, channels=()) if "depth" in outputs else None
    entry = find(data, TIME)
    if entry is None:
        raise FrameUnusable(f"no {TIME} among {sorted(data)}")
    return Frame(hdr=hdr, motion=motion, t_ns=round(seconds(entry) * 1e9), rgb=rgb, depth=depth)


def _image(data, name, height, width, channels=(4,)):
    array = payload(find(data, name))
    if array is None:
        raise FrameUnusable(f"no {name} among {sorted(data)}")
    shape = tuple(getattr(array, "shape", ()))
    if not shape or 0 in shape:
        raise FrameUnusable(f"{name} is empty: the renderer has not drawn yet", expected=True)
    if shape != (height, width, *channels):
        # Kit drops axes of length 1, so an image of one row or column cannot be told from a list.
        raise FrameUnusable(f"{name} has shape {shape}, expected {(height, width, *channels)}")
    return array
