"""Renders a Blender scene as a folder for `esaac simulate`: multilayer frames, and the poses of all that moves.

    blender scene.blend --background --python blender_frames.py -- --out frames --pose-rate 960
    python blender_frames.py --blend scene.blend --out frames      # with `pip install bpy`

The frames have colour, depth, motion vectors and object indices; `sequence.json` has the lens, and poses between the
frames. Objects that deform, change their size or are scattered in many copies get no poses: `esaac` then follows
their motion vectors. The script needs Blender's own Python alone, and leaves the .blend file as it is.
"""

import argparse
import json
import math
import pathlib
import sys

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--out", type=pathlib.Path, default=pathlib.Path("frames"), help="folder; new or empty")
PARSER.add_argument("--blend", type=pathlib.Path, help="scene, where Blender has not opened one")
PARSER.add_argument("--pose-rate", type=float, default=960.0, metavar="HZ", help="poses a second")
PARSER.add_argument("--samples", type=int, help="samples a pixel, otherwise the scene's")


def told():
    """The arguments: those after `--`, where Blender has its own before."""
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    return PARSER.parse_args(words)


if __name__ == "__main__":
    # `--help` needs none of the packages below.
    told()

import numpy as np

MOST_INDEX = 32767
"""Greatest pass index that Blender takes."""
RIGID_WITHIN = 1e-4
"""Strain that single precision may make of a rigid motion."""
STILL_WITHIN = 1e-6
"""Part of an object's distance from the origin, or of a metre, within which it stands still."""
AT_FRAME = 1e-6
"""A pose this near to a frame, in frames, is at its time."""


WITH_POINTS = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
"""Types of objects that can be turned into a mesh."""
DRAWN = WITH_POINTS | {"CURVES", "POINTCLOUD", "VOLUME"}
"""Types of objects that are drawn."""


class Unfit(Exception):
    """Something of the scene that a folder of frames cannot say."""


def pinhole(size_px, aspect, lens_mm, sensor_mm, sensor_fit, shift):
    """`intrinsics` of a perspective camera. The centre of pixel (i, j) is at (i, j).

    `aspect`: of a pixel, x and y. `sensor_mm`: width and height. `shift`: x and y, in parts of the fitted side.
    """
    (width, height), (aspect_x, aspect_y) = size_px, aspect
    if sensor_fit == "AUTO":
        # The longer side has the sensor's width.
        fits_width, side_mm = width * aspect_x >= height * aspect_y, sensor_mm[0]
    else:
        fits_width = sensor_fit == "HORIZONTAL"
        side_mm = sensor_mm[0 if fits_width else 1]
    # The fitted side in units of which a pixel is `aspect` wide and high.
    side = width * aspect_x if fits_width else height * aspect_y
    focal = side * lens_mm / side_mm
    return {
        "fx": focal / aspect_x,
        "fy": focal / aspect_y,
        "cx": (width - 1) / 2 - shift[0] * side / aspect_x,
        "cy": (height - 1) / 2 + shift[1] * side / aspect_y,
    }


def fisheye(size_px, fov):
    """`intrinsics` of Blender's equidistant fisheye: `fov` radians across the width and across the height."""
    width, height = size_px
    centre = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return {"projection": "fisheye", "fx": width / fov, "fy": height / fov, **centre}


def pose_frames(first, count, key_rate_hz, pose_rate_hz):
    """The frames, with fractions, at which poses are taken: from the first frame on, to the last or just beyond."""
    per_pose = key_rate_hz / pose_rate_hz
    last = max(math.ceil((count - 1) / per_pose - AT_FRAME), 0)
    return [first + per_pose * j for j in range(last + 1)]


def split_frame(frame):
    """Whole frame and fraction, as `frame_set` takes them."""
    near = round(frame)
    if abs(frame - near) < AT_FRAME:
        return near, 0.0
    whole = math.floor(frame)
    return whole, frame - whole


def nearest_turn(matrices):
    """The rotations nearest to 3x3 matrices."""
    left, _, right = np.linalg.svd(matrices)
    mirrored = np.linalg.det(left @ right) < 0
    left[mirrored, :, -1] *= -1
    return left @ right


def rigid_poses(matrices):
    """Poses without scale of a body whose 4x4 matrices, body to world, are given.

    Scale, shear and mirroring that stay are the body's shape. `None` if its motion is not rigid.
    """
    matrices = np.asarray(matrices, float)
    shape = matrices[0, :3, :3]
    if np.linalg.cond(shape) > 1e6:
        # Flattened: no motion can be told from it, unless there is none.
        if is_still(matrices):
            return with_turns(nearest_turn(shape[None]), matrices[:1, :3, 3]).repeat(len(matrices), axis=0)
        return None
    motion = matrices[:, :3, :3] @ np.linalg.inv(shape)
    strain = np.abs(np.swapaxes(motion, 1, 2) @ motion - np.eye(3)).max()
    if not strain <= RIGID_WITHIN or np.linalg.det(motion).min() < 0:
        return None
    return with_turns(nearest_turn(motion) @ nearest_turn(shape[None])[0], matrices[:, :3, 3])


def with_turns(turns, places):
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns, places
    return poses


def is_still(matrices):
    matrices = np.asarray(matrices, float)
    return np.abs(matrices - matrices[0]).max() <= STILL_WITHIN * max(1.0, np.abs(matrices[0]).max())


def pass_indices(given, needed):
    """A pass index for each object: its own if that is unique and not 0, a free one for others that are `needed`.

    `given`: the own index of each name. Others get 0, the static world.
    """
    owners = {}
    for name, index in given.items():
        owners.setdefault(index, []).append(name)
    kept = {owned[0]: index for index, owned in owners.items() if index != 0 and len(owned) == 1}
    free = (index for index in range(1, MOST_INDEX + 1) if index not in kept.values())
    chosen = {}
    for name in given:
        chosen[name] = kept.get(name) or (next(free, None) if name in needed else 0)
        if chosen[name] is None:
            raise Unfit(f"{len(needed)} objects move, expected at most {MOST_INDEX}")
    return chosen


def lens_of(scene, camera):
    """`intrinsics` of a camera, evaluated at the frame."""
    render, data = scene.render, camera.data
    size_px = [
        side * render.resolution_percentage // 100 for side in (render.resolution_x, render.resolution_y)
    ]
    aspect = (render.pixel_aspect_x, render.pixel_aspect_y)
    if data.type == "PERSP":
        sensor_mm, shift = (data.sensor_width, data.sensor_height), (data.shift_x, data.shift_y)
        return pinhole(size_px, aspect, data.lens, sensor_mm, data.sensor_fit, shift)
    if data.type != "PANO":
        raise Unfit(f"camera {camera.name} is of type {data.type}, expected PERSP or a fisheye")
    # Since version 5 a property of the camera.
    panorama = data if hasattr(data, "panorama_type") else data.cycles
    if panorama.panorama_type != "FISHEYE_EQUIDISTANT":
        kind = panorama.panorama_type
        raise Unfit(f"panorama of camera {camera.name} is {kind}, expected FISHEYE_EQUIDISTANT")
    if aspect[0] != aspect[1] or data.shift_x or data.shift_y:
        raise Unfit(
            f"fisheye of camera {camera.name} has a shift or pixels that are not square, expected neither"
        )
    return fisheye(size_px, panorama.fisheye_fov)


class Drawn:
    """An object that is drawn, and what it does over the frames."""

    def __init__(self, original):
        self.original, self.matrices, self.copies = original, [], {}
        self.points, self.deforms = None, False

    def is_still(self, frames):
        """Whether nothing of it moves over so many frames. A copy that comes or goes moves, too."""
        copies = self.copies.values()
        stays = all(len(seen) == frames and is_still(seen) for seen in copies)
        return not self.deforms and stays and (not self.matrices or is_still(self.matrices))

    def may_deform(self):
        thing = self.original
        data = thing.data
        return bool(
            thing.modifiers
            or getattr(data, "shape_keys", None)
            or data.animation_data
            or thing.parent_type in {"ARMATURE", "LATTICE", "CURVE"}
            or thing.type in {"META", "VOLUME"}
        )

    def compare(self, evaluated):
        """Notes whether its points are elsewhere in its own axes than at first."""
        if self.deforms or not self.may_deform():
            return
        if self.original.type not in WITH_POINTS:
            self.deforms = True
            return
        mesh = evaluated.to_mesh()
        points = np.empty(3 * len(mesh.vertices) if mesh else 0, np.float32)
        if mesh:
            mesh.vertices.foreach_get("co", points)
        evaluated.to_mesh_clear()
        if self.points is None:
            self.points = points
        elif len(points) != len(self.points):
            self.deforms = True
        elif len(points):
            reach = max(float(np.abs(self.points).max()), STILL_WITHIN)
            self.deforms = float(np.abs(points - self.points).max()) > RIGID_WITHIN * reach


def prepare(scene, samples):
    """Turns on what is needed, and off what would spoil it; tells the latter."""
    render = scene.render
    if render.engine != "CYCLES":
        raise Unfit(f"the render engine is {render.engine}, expected CYCLES: others write no object indices")
    layers = [layer for layer in scene.view_layers if layer.use]
    if not layers:
        raise Unfit("no view layer is rendered, expected one")
    for layer in layers[1:]:
        layer.use = False
        print(f"view layer {layer.name} is left out: frames have one")
    layer = layers[0]
    layer.use_pass_combined = layer.use_pass_z = layer.use_pass_vector = layer.use_pass_object_index = True
    for name, why in (
        ("use_motion_blur", "motion blur is off: Cycles has no motion vectors with it"),
        ("use_border", "the render region is left out: whole images are rendered"),
        ("use_multiview", "stereo is off: a folder has one camera"),
    ):
        if getattr(render, name):
            setattr(render, name, False)
            print(why)
    render.use_compositing = render.use_sequencer = False
    if samples is not None:
        scene.cycles.samples = samples
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    if hasattr(image, "use_exr_interleave"):
        # In a part for each pass, Blender 5.0 fails to write pixels that are not square.
        image.use_exr_interleave = True
    render.use_overwrite = render.use_file_extension = True
    show(layer, layer.layer_collection)
    return layer


def show(layer, collection):
    """Shows in the viewport, from which poses are read, what is rendered."""
    collection.hide_viewport = False
    collection.collection.hide_viewport = collection.collection.hide_render
    for thing in collection.collection.objects:
        if thing.name in layer.objects and not thing.hide_render:
            thing.hide_viewport = False
            thing.hide_set(False, view_layer=layer)
            for modifier in thing.modifiers:
                modifier.show_viewport = modifier.show_render
    for child in collection.children:
        if not child.exclude:
            show(layer, child)


def survey(scene, layer, frames, frame_poses):
    """The lens, the camera's matrices at `frame_poses`, and the objects that are drawn.

    What deforms or is copied is looked at in each frame, also where poses miss it."""
    camera = scene.camera
    if camera is None:
        raise Unfit("the scene has no camera, expected one")
    drawn, eyes, lens = {}, [], None
    posed = {split_frame(frame) for frame in frame_poses}
    for whole, part in sorted(posed | {(frame, 0.0) for frame in frames}):
        scene.frame_set(whole, subframe=part)
        if scene.camera != camera:
            raise Unfit(f"frame {whole} has camera {scene.camera.name}, expected {camera.name} for all")
        graph = layer.depsgraph
        eye = camera.evaluated_get(graph)
        if (whole, part) in posed:
            eyes.append([list(row) for row in eye.matrix_world])
        told_lens = lens_of(scene, eye)
        lens = lens or told_lens
        if any(abs(told_lens[key] - lens[key]) > 1e-6 * abs(lens["fx"]) for key in ("fx", "fy", "cx", "cy")):
            raise Unfit(f"the lens is {told_lens} at frame {whole + part:g}, expected {lens} as at first")
        for thing in layer.objects:
            if thing.type in DRAWN and (thing.animation_data or not thing.hide_render):
                one = drawn.setdefault(thing.name_full, Drawn(thing))
                if (whole, part) in posed:
                    one.matrices.append([list(row) for row in thing.evaluated_get(graph).matrix_world])
        if part == 0.0 and whole in frames:
            for one in drawn.values():
                one.compare(one.original.evaluated_get(graph))
            add_copies(graph, drawn)
    return lens, eyes, drawn


def add_copies(graph, drawn):
    """Takes the copies that particles, collections and geometry nodes make of objects."""
    for copy in graph.object_instances:
        original = copy.object.original
        if copy.is_instance and original.type in DRAWN:
            key = (copy.parent.original.name_full if copy.parent else "", *copy.persistent_id)
            matrix = [list(row) for row in copy.matrix_world]
            # The original need not be in the view layer itself.
            one = drawn.setdefault(original.name_full, Drawn(original))
            one.copies.setdefault(key, []).append(matrix)


def instances_of(drawn, frames):
    """Poses by pass index, which is set; tells the objects that get none."""
    still = {name for name, thing in drawn.items() if thing.is_still(frames)}
    indices = pass_indices(
        {name: thing.original.pass_index for name, thing in drawn.items()}, set(drawn) - still
    )
    instances = {}
    for name, thing in drawn.items():
        index = thing.original.pass_index = indices[name]
        if index == 0:
            continue
        poses = rigid_poses(thing.matrices or [np.eye(4)])
        lacks = None
        if thing.copies and name not in still:
            lacks = "is drawn in copies (particles, a collection or geometry nodes)"
        elif thing.deforms:
            lacks = "deforms"
        elif poses is None:
            lacks = "changes its size or shape"
        if lacks:
            print(f"object {name}, index {index}, {lacks}: no poses, its motion vectors are followed")
            continue
        instances[str(index)] = poses[:1].tolist() if name in still else poses.tolist()
        print(f"object {name}, index {index}: {'stands still' if name in still else 'poses'}")
    return instances


def sequence(scene, layer, pose_rate_hz):
    """The contents of `sequence.json`. Sets pass indices."""
    if not pose_rate_hz > 0:
        raise Unfit(f"--pose-rate is {pose_rate_hz:g}, expected a positive number")
    first, last, step = scene.frame_start, scene.frame_end, scene.frame_step
    frames = range(first, last + 1)
    if step != 1:
        raise Unfit(f"the frame step is {step}, expected 1: motion vectors are those from frame to frame")
    if len(frames) < 2:
        raise Unfit(f"frames {first} to {last} are {len(frames)}, expected at least 2")
    key_rate_hz = scene.render.fps / scene.render.fps_base
    taken = pose_frames(first, len(frames), key_rate_hz, pose_rate_hz)
    lens, eyes, drawn = survey(scene, layer, frames, taken)
    camera = rigid_poses([np.array(eye) @ unscaled(eye) for eye in eyes])
    if camera is None or np.linalg.det(np.array(eyes[0])[:3, :3]) < 0:
        raise Unfit(f"camera {scene.camera.name} is sheared or mirrored, expected neither")
    instances = instances_of(drawn, len(frames))
    return {
        "key_rate_hz": key_rate_hz,
        "intrinsics": lens,
        "pose_rate_hz": pose_rate_hz,
        "camera_to_world": camera.tolist(),
        "instances": instances,
    }


def unscaled(matrix):
    """What takes the scale of a camera away, which Blender ignores."""
    lengths = np.linalg.norm(np.array(matrix)[:3, :3], axis=0)
    return np.diag([*(1 / lengths), 1.0])


def main():
    arguments = told()
    import bpy

    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise Unfit(f"{out} has files, expected an empty folder")
    if arguments.blend:
        if not arguments.blend.is_file():
            raise Unfit(f"there is no file {arguments.blend}")
        bpy.ops.wm.open_mainfile(filepath=str(arguments.blend.resolve()))
    scene = bpy.context.scene
    layer = prepare(scene, arguments.samples)
    described = sequence(scene, layer, arguments.pose_rate)
    scene.render.filepath = str(out / "frame_####")
    bpy.ops.render.render(animation=True, scene=scene.name)
    # Last, so that a folder with it has all its frames.
    (out / "sequence.json").write_text(json.dumps(described))
    print(f"{len(list(out.glob('*.exr')))} frames and {len(described['camera_to_world'])} poses in {out}")


if __name__ == "__main__":
    try:
        main()
    except Unfit as unfit:
        sys.exit(f"error: {unfit}")
