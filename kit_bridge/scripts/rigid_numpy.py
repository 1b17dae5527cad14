"""Events along exact paths: a renderer in NumPy that gives colour, depth, instance ids and poses.

    python kit_bridge/scripts/rigid_numpy.py

A camera shakes before a wall, and a box turns and passes between them. Physics steps at 480 Hz; frames are rendered
at 30 Hz. The events made of these frames, with poses and without, are compared with those of the same scene rendered
at 960 Hz. Motion vectors are never computed.
"""

import argparse

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--seconds", type=float, default=0.5)

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import numpy as np

import esaac

WIDTH, HEIGHT, FOCAL_PX = 96, 72, 90.0
LENS = esaac.Intrinsics(FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
WALL_M, HALF_BOX_M = -3.0, np.array([0.35, 0.25, 0.2])
BOX = 1
"""Id of the box. 0, the wall's, is the static world."""
PHYSICS_HZ, FRAME_HZ, TRUTH_HZ = 480, 30, 960
SAMPLES = 3
"""Rays a pixel along each axis."""


def turn(axis, angle):
    """A quaternion x y z w."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.array([*(axis * np.sin(angle / 2)), np.cos(angle / 2)])


def matrix(quaternion):
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def camera_pose(t):
    """World from camera: it looks along -z, x right, y up."""
    shake = 0.03 * np.sin(2 * np.pi * 11 * t) + 0.02 * np.sin(2 * np.pi * 9 * t + 1)
    return np.array([0.1 * np.sin(2 * np.pi * 3 * t), 0, 0, *turn((0.4, 1, 0.1), shake)])


def box_pose(t):
    return np.array([0.9 * t - 0.3, 0.2 * t - 0.05, -1.8, *turn((0.3, 1, 0.2), 3 * t)])


def render(t, width=WIDTH, height=HEIGHT, samples=SAMPLES, box=box_pose):
    """Colour, depth along the axis and ids at a time."""
    _, fx, fy, cx, cy = LENS.told()
    cx, cy = cx + (width - WIDTH) / 2, cy + (height - HEIGHT) / 2
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    x = (np.arange(width)[:, None] + steps).ravel()
    y = (np.arange(height)[:, None] + steps).ravel()
    across, down = np.meshgrid((x - cx) / fx, (y - cy) / fy)
    rays = np.stack([across, -down, -np.ones_like(across)], axis=-1)
    pose = camera_pose(t)
    eye, rays = pose[:3], rays @ matrix(pose[3:]).T
    depth = (WALL_M - eye[2]) / rays[..., 2]
    light = texture(eye[:2] + depth[..., None] * rays[..., :2], 14.0)
    ids = np.zeros(depth.shape, np.uint32)
    near, inside = hit(eye, rays, box(t))
    seen = near < depth
    light[seen] = texture(inside[seen] @ np.array([[1, 0.3], [0.2, 1], [0.5, 0.7]]), 21.0)
    depth, ids = np.where(seen, near, depth), np.where(seen, BOX, ids).astype(np.uint32)
    light = light.reshape(height, samples, width, samples).mean(axis=(1, 3))
    centres = slice(samples // 2, None, samples)
    hdr = np.repeat(light[..., None], 4, axis=-1).astype(np.float32)
    return hdr, depth[centres, centres].astype(np.float32), ids[centres, centres]


def texture(at, density):
    u, v = np.moveaxis(at, -1, 0) * density
    return 0.4 + 0.17 * (np.sin(u) + np.sin(0.7 * v + 1)) * np.cos(0.4 * u - 0.8 * v)


def hit(eye, rays, pose):
    """Depth at which rays enter the box (infinite where they miss it), and where that is in its axes."""
    axes = matrix(pose[3:])
    start, along = (eye - pose[:3]) @ axes, rays @ axes
    with np.errstate(divide="ignore"):
        walls = (np.stack([-HALF_BOX_M, HALF_BOX_M]) - start)[:, None, None] / along
    enter, leave = walls.min(axis=0).max(axis=-1), walls.max(axis=0).min(axis=-1)
    depth = np.where((enter < leave) & (enter > 0), enter, np.inf)
    return depth, start + np.where(np.isfinite(depth), depth, 0)[..., None] * along


def run(rate_hz, seconds, synthesis):
    """Events of the scene rendered at a rate: arrays x, y, t_ns, p; and the counts of pixels without a path."""
    sensor = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.15, "contrast_off": 0.15}
    camera = esaac.EventCamera("dvs128", intrinsics=LENS, synthesis=synthesis, **sensor)
    recorder, packets, lost = esaac.PoseRecorder(ids={BOX: 0}), [], []
    steps = 0
    for frame in range(round(seconds * rate_hz) + 1):
        # A simulator calls this after each of its physics steps.
        while steps / PHYSICS_HZ <= frame / rate_hz:
            t = steps / PHYSICS_HZ
            recorder.record(round(t * 1e9), camera_pose(t), box_pose(t)[None])
            steps += 1
        hdr, depth, ids = render(frame / rate_hz)
        t_ns = round(frame / rate_hz * 1e9)
        if synthesis == "rigid":
            packets.append(camera.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=recorder))
        else:
            packets.append(camera.step(hdr, t_ns=t_ns))
        counts = camera.statistics.items()
        lost.append({name: n for name, n in counts if n and name.startswith(("without", "unseen"))})
    events = tuple(np.concatenate([getattr(p, name) for p in packets]) for name in ("x", "y", "t_ns", "p"))
    return events, lost


def f1(events, truth, within_ns=1_000_000):
    """Share of events that have one of the truth's at the same pixel, of the same sign, within a time."""
    times = []
    for x, y, t_ns, p in (events, truth):
        pixel = (y.astype(np.int64) * WIDTH + x) * 2 + p
        order = np.lexsort((t_ns, pixel))
        keys, starts = np.unique(pixel[order], return_index=True)
        times.append(dict(zip(keys.tolist(), np.split(t_ns[order], starts[1:]))))
    matched = 0
    for pixel, ours in times[0].items():
        theirs, at = times[1].get(pixel, ()), 0
        for t_ns in ours:
            while at < len(theirs) and theirs[at] < t_ns - within_ns:
                at += 1
            if at < len(theirs) and theirs[at] <= t_ns + within_ns:
                matched, at = matched + 1, at + 1
    return 2 * matched / (len(events[0]) + len(truth[0]))


def main():
    seconds = PARSER.parse_args().seconds
    truth, _ = run(TRUTH_HZ, seconds, "linear")
    print(f"{TRUTH_HZ} Hz, colour: {len(truth[0])} events, taken for the truth")
    for synthesis, given in (("linear", "colour"), ("rigid", "colour, depth, ids, poses")):
        events, lost = run(FRAME_HZ, seconds, synthesis)
        score = f1(events, truth)
        print(f"{FRAME_HZ} Hz, {given} ({synthesis}): {len(events[0])} events, F1 within 1 ms {score:.3f}")
        if lost[-1]:
            print("  last frame:", ", ".join(f"{n} {name}" for name, n in lost[-1].items()))


if __name__ == "__main__":
    main()
