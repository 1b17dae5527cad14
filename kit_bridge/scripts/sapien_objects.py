"""SAPIEN's renderer as an event camera: boxes fall on a table while the camera circles them.

    pip install esaac sapien cupy-cuda13x
    python kit_bridge/scripts/sapien_objects.py --out out/

Colour and motion never leave the GPU: SAPIEN draws into CUDA memory, CuPy makes motion vectors of its positions
and labels, and `esaac` reads both where they lie. SAPIEN draws no motion vectors itself, but what they follow from:
each pixel's position before the camera, and which body it is of. Where a body's pose was one frame ago is known, so
where each point was is too.
"""

import argparse
import pathlib
import time

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out"))
PARSER.add_argument("--frames", type=int, default=90)

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import cupy as cp
import numpy as np
import sapien

import esaac

WIDTH, HEIGHT, RATE_HZ, FOV_Y = 346, 260, 60, 0.9


def scene_of(seed=3):
    """A table, and a heap of boxes above it."""
    random = np.random.default_rng(seed)
    scene = sapien.Scene()
    scene.set_timestep(1 / (4 * RATE_HZ))
    scene.set_ambient_light([0.35, 0.35, 0.4])
    scene.add_directional_light([0.4, 0.6, -1], [2.2, 2.1, 1.9], shadow=True)
    bodies = []
    # Strips of the floor give it texture.
    for i in range(-8, 9):
        for j in range(-8, 9):
            tile = scene.create_actor_builder()
            shade = 0.15 if (i + j) % 2 else 0.75
            tile.add_box_visual(half_size=[0.15, 0.15, 0.01], material=[shade, shade, shade * 0.9])
            bodies.append(tile.build_static(name="tile"))
            bodies[-1].set_pose(sapien.Pose([0.3 * i, 0.3 * j, -0.01]))
    floor = scene.create_actor_builder()
    floor.add_box_collision(half_size=[5, 5, 0.01])
    floor.build_static(name="floor").set_pose(sapien.Pose([0, 0, -0.01]))
    for k in range(14):
        box = scene.create_actor_builder()
        half = (0.07 + 0.09 * random.random(3)).tolist()
        box.add_box_collision(half_size=half)
        box.add_box_visual(half_size=half, material=(0.15 + 0.8 * random.random(3)).tolist())
        body = box.build(name=f"box {k}")
        turn = random.normal(size=4)
        at = [*(0.5 * random.standard_normal(2)), 0.6 + 0.28 * k]
        body.set_pose(sapien.Pose(at, turn / np.linalg.norm(turn)))
        bodies.append(body)
    return scene, bodies


def look_at(eye, target):
    """SAPIEN's camera looks along +x, with z up."""
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    left = np.cross([0, 0, 1], forward)
    left /= np.linalg.norm(left)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([forward, left, np.cross(forward, left)], axis=1)
    pose[:3, 3] = eye
    return sapien.Pose(pose)


class MotionVectors:
    """Motion of each pixel, from where its point is and where its body was."""

    def __init__(self, camera, bodies):
        self.camera, self.bodies = camera, bodies
        self.labels = [body.per_scene_id for body in bodies]
        self.k = camera.get_intrinsic_matrix()
        self.before = None

    def __call__(self, position, segmentation):
        # Points of OpenGL's camera: x right, y up, z back.
        model = self.camera.get_model_matrix()
        poses = np.stack([body.pose.to_transformation_matrix() for body in self.bodies])
        # One matrix a label: a point before this camera to the same point before the last one.
        table = np.tile(np.eye(4), (max(self.labels) + 1, 1, 1))
        if self.before is not None:
            model_before, poses_before = self.before
            to_camera = np.linalg.inv(model_before)
            table[:] = to_camera @ model
            table[self.labels] = to_camera @ poses_before @ np.linalg.inv(poses) @ model
        self.before = model, poses
        table = cp.asarray(table, cp.float32)
        label = cp.clip(segmentation[..., 1].astype(cp.int32), 0, len(table) - 1)
        here = position[..., :3]
        step = table[label]
        there = (step[..., :3, :3] @ here[..., None])[..., 0] + step[..., :3, 3]
        drawn = here[..., 2] < -1e-4
        motion = self._pixel(there) - self._pixel(here)
        return cp.ascontiguousarray(cp.where(drawn[..., None], motion, 0).astype(cp.float32))

    def _pixel(self, point):
        depth = cp.maximum(-point[..., 2], 1e-4)
        x = self.k[0, 0] * point[..., 0] / depth + self.k[0, 2]
        y = -self.k[1, 1] * point[..., 1] / depth + self.k[1, 2]
        return cp.stack([x, y], axis=-1)


def drawing(camera, name):
    """One of the camera's drawings, as CuPy's array where it lies."""
    return cp.asarray(camera.get_picture_cuda(name))


def picture(path, colours, frames):
    """Colour above events: red ON, blue OFF, on white."""
    rows = []
    for colour, counts in zip(colours, frames):
        off, on = np.clip(counts.astype(float) / 3, 0, 1)
        events = 1 - np.stack([off, np.maximum(on, off), on], axis=-1)
        rows.append(np.concatenate([np.clip(colour[..., :3], 0, 1), events], axis=0))
    image = (np.concatenate(rows, axis=1) * 255).astype(np.uint8)
    from PIL import Image

    Image.fromarray(image).save(path)


def main():
    arguments = PARSER.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    scene, bodies = scene_of()
    camera = scene.add_camera(name="events", width=WIDTH, height=HEIGHT, fovy=FOV_Y, near=0.05, far=50)
    motion_vectors = MotionVectors(camera, bodies)
    sensor = esaac.SensorModel("davis346", contrast_on=0.2, contrast_off=0.2)
    colours, frames, step_us = [], [], []
    shown = set(np.linspace(arguments.frames * 0.25, arguments.frames - 1, 4).astype(int).tolist())
    with (
        esaac.EventCamera(sensor, device="cuda:0", packets="cuda") as events,
        esaac.EventWriter(arguments.out / "events.npz", sensor) as record,
    ):
        for index in range(arguments.frames):
            for _ in range(4):
                scene.step()
            angle = 0.6 * index / RATE_HZ
            camera.entity.set_pose(look_at([2.6 * np.cos(angle), 2.6 * np.sin(angle), 1.5], [0, 0, 0.35]))
            scene.update_render()
            camera.take_picture()
            colour = drawing(camera, "Color")
            motion = motion_vectors(drawing(camera, "Position"), drawing(camera, "Segmentation"))
            # SAPIEN's default shader encodes for a screen; the sensor sees light.
            hdr = cp.where(colour > 0.04045, ((colour + 0.055) / 1.055) ** 2.4, colour / 12.92)
            hdr = hdr.astype(cp.float16)
            cp.cuda.Device().synchronize()
            started = time.perf_counter()
            packet = events.step(hdr, motion, t_ns=round(index * 1e9 / RATE_HZ))
            step_us.append(1e6 * (time.perf_counter() - started))
            record.write(packet)
            if index in shown:
                colours.append(cp.asnumpy(colour))
                frames.append(cp.asnumpy(cp.from_dlpack(events.event_frame())))
        counts = events.statistics
    picture(arguments.out / "sapien.png", colours, frames)
    print(
        f"{len(record)} events of {arguments.frames} frames; step p50 {np.median(step_us[3:]):.0f} us; "
        f"host copies {counts['host_copies']}; {arguments.out}/events.npz, {arguments.out}/sapien.png"
    )


if __name__ == "__main__":
    main()
