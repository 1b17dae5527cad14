"""Blender as the renderer: frames with HDR colour and motion vectors, straight from `bpy` to events.

    pip install bpy esaac          # bpy wants the Python that its version was built for
    python kit_bridge/scripts/blender_events.py --out out/

Cycles renders; its `Vector` pass holds where each pixel was in the frame before (x, y) and is in the one after
(z, w), in pixels with y up. `esaac` wants *previous position = position + motion*, y down: (x, -y).
"""

import argparse
import math
import pathlib

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
PARSER.add_argument("--frames", type=int, default=8)
PARSER.add_argument("--samples", type=int, default=16)
PARSER.add_argument("--size", type=int, nargs=2, default=(160, 120), metavar=("WIDTH", "HEIGHT"))

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import bpy
import numpy as np

import esaac


def build(width, height, rate_hz, samples):
    """A lit room of boxes, one of which turns and slides."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", samples, False
    # The same sampling pattern in every frame: noise that stays does not send events.
    scene.cycles.seed, scene.cycles.use_animated_seed = 1, False
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage, scene.render.fps = 100, rate_hz
    scene.view_layers[0].use_pass_vector = True
    world = bpy.data.worlds.new("world")
    scene.world = world
    world.color = (0.3, 0.32, 0.36)
    for index in range(9):
        bpy.ops.mesh.primitive_cube_add(size=0.7, location=(1.1 * (index % 3 - 1), 1.1 * (index // 3 - 1), 0))
        _paint(bpy.context.object, 0.1 + 0.1 * index)
    bpy.ops.mesh.primitive_plane_add(size=12, location=(0, 0, -0.35))
    _paint(bpy.context.object, 0.5)
    bpy.ops.mesh.primitive_cube_add(size=0.6, location=(-1.5, -0.5, 0.9))
    moving = bpy.context.object
    _paint(moving, 0.9)
    for frame, x in ((0, -1.5), (60, 1.5)):
        moving.location.x, moving.rotation_euler.z = x, 1.2 * x
        moving.keyframe_insert("location", frame=frame)
        moving.keyframe_insert("rotation_euler", frame=frame)
    light = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    light.data.energy, light.rotation_euler = 3.0, (0.6, 0.3, 0)
    scene.collection.objects.link(light)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0, -4.5, 4.2), (math.radians(48), 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def _paint(thing, value):
    material = bpy.data.materials.new(f"shade {value:.1f}")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (
        value,
        value,
        value * 0.8,
        1,
    )
    thing.data.materials.append(material)


def render(scene, frame, folder):
    """Colour and motion of a frame, by an OpenEXR file: Blender gives scripts no passes in memory."""
    scene.frame_set(frame)
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(folder / f"frame_{frame:04}.exr")
    bpy.ops.render.render(write_still=True)
    return read_passes(scene.render.filepath)


def read_passes(path):
    """The passes of a multilayer file."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        # Blender 5 writes a part a pass, Blender 4 all passes in one.
        channels = {name: c.pixels for part in file.parts for name, c in part.channels.items()}

    def stack(pass_name, components):
        named = [next(n for n in channels if n.endswith(f"{pass_name}.{c}")) for c in components]
        return np.stack([channels[name] for name in named], axis=-1).astype(np.float32)

    return stack("Combined", "RGB"), stack("Vector", "XY") * np.float32((1, -1))


def main():
    arguments = PARSER.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rate_hz, (width, height) = 30, arguments.size
    scene = build(width, height, rate_hz, arguments.samples)
    sensor = esaac.SensorModel("davis346", width=width, height=height)
    with (
        esaac.EventCamera(sensor) as camera,
        esaac.EventWriter(arguments.out / "events.npz", sensor) as events,
    ):
        for frame in range(arguments.frames):
            # From where the box is at speed.
            hdr, motion = render(scene, 20 + frame, arguments.out)
            packet = camera.step(hdr, motion, t_ns=round(frame * 1e9 / rate_hz))
            print(f"frame {frame}: {len(packet)} events, motion up to {np.abs(motion).max():.1f} px")
            events.write(packet)
    print(f"{len(events)} events in {arguments.out}/events.npz")


if __name__ == "__main__":
    main()
