"""Events of a still scene of Gaussian splats, along a camera's path. gsplat draws it.

    python kit_bridge/scripts/gsplat_events.py --splats splats.ply --path transforms.json --out events.npz

`--splats` is a PLY file as training writes it (`ns-export gaussian-splat` of nerfstudio, or the first authors' code);
it needs `plyfile`. `--path` is nerfstudio's `transforms.json`, whose poses are taken at `--rate`. Without `--splats`
the script draws a scene of its own, and without `--path` the camera shakes.

Needs `torch` and `gsplat`, which draws on NVIDIA GPUs. The tests put another renderer of splats in its place.
"""

import argparse
import pathlib
import sys

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--splats", help="a PLY file")
PARSER.add_argument("--path", help="nerfstudio's transforms.json")
PARSER.add_argument("--dataparser", help="dataparser_transforms.json, if nerfstudio trained the splats")
PARSER.add_argument("--rate", type=float, default=30.0, help="frames a second")
PARSER.add_argument("--seconds", type=float, default=0.5, help="of shaking")
PARSER.add_argument("--size", type=int, nargs=2, default=(346, 260), help="columns and rows, of shaking")
PARSER.add_argument("--device", default="cuda:0")
PARSER.add_argument("--contrast", type=float, default=0.2)
PARSER.add_argument("--out", type=pathlib.Path, help="a recording: .npz, or .h5 with h5py")

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import numpy as np
import torch
from gsplat import rasterization

import esaac
from esaac.still import CameraPath, view_of, visible_depth

POSES_HZ = 480
SH_OF_GREY = 0.28209479177387814
"""Of spherical harmonics, the first: colour = .5 + this times the first coefficient."""


def own_scene(device):
    """A wall of splats, and a board before it."""
    random = np.random.default_rng(1)
    parts = []
    for across, down, apart_m, middle_m in ((16, 12, 0.3, (0, 0, -3.0)), (6, 5, 0.15, (0.25, 0.1, -1.9))):
        x, y = np.meshgrid(np.arange(across) - (across - 1) / 2, np.arange(down) - (down - 1) / 2)
        # Splats are drawn in the order of their depths. Were these equal, a turn would change what is on top.
        depths = random.uniform(-0.3, 0.3, x.shape)
        places = np.stack([x, y, depths], axis=-1).reshape(-1, 3) * apart_m + middle_m
        sizes_m = np.full((len(places), 3), 0.5 * apart_m) * (1, 1, 0.05)
        parts.append((places, sizes_m, random.uniform(0.15, 0.9, (len(places), 3))))
    places, sizes_m, colours = (
        torch.tensor(np.concatenate(part), dtype=torch.float32) for part in zip(*parts)
    )
    turns = torch.tensor([[1.0, 0, 0, 0]]).expand(len(places), 4)
    return {
        "means": places.to(device),
        "quats": turns.to(device),
        "scales": sizes_m.to(device),
        "opacities": torch.full((len(places),), 0.995, device=device),
        "colors": ((colours - 0.5) / SH_OF_GREY)[:, None].to(device),
    }


def read_splats(path, device):
    """A PLY file's splats: logarithms of sizes, logits of opacities, quaternions w x y z, spherical harmonics."""
    from plyfile import PlyData

    vertices = PlyData.read(path)["vertex"]
    of = lambda *names: torch.tensor(
        np.stack([vertices[name] for name in names], axis=-1), dtype=torch.float32
    )
    count = sum(one.name.startswith("f_rest_") for one in vertices.properties)
    colours = of("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if count:
        rest = of(*(f"f_rest_{number}" for number in range(count)))
        colours = torch.cat([colours, rest.reshape(len(rest), 3, count // 3).transpose(1, 2)], dim=1)
    turns = of("rot_0", "rot_1", "rot_2", "rot_3")
    splats = {
        "means": of("x", "y", "z"),
        "quats": turns / turns.norm(dim=1, keepdim=True),
        "scales": of("scale_0", "scale_1", "scale_2").exp(),
        "opacities": of("opacity")[:, 0].sigmoid(),
        "colors": colours,
    }
    return {name: values.to(device) for name, values in splats.items()}


def draw(splats, world_from_camera, lens, width, height, background=0.5):
    """Linear colour and depth along the axis, as a camera sees them whose axes are OpenGL's."""
    device = splats["means"].device
    matrix = [[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]]
    image, opacity, _ = rasterization(
        **splats,
        viewmats=torch.tensor(view_of(world_from_camera), dtype=torch.float32, device=device)[None],
        Ks=torch.tensor(matrix, dtype=torch.float32, device=device)[None],
        width=width,
        height=height,
        sh_degree=round(splats["colors"].shape[1] ** 0.5) - 1,
        render_mode="RGB+ED",
        rasterize_mode="antialiased",
    )
    colour = image[0, ..., :3] + (1 - opacity[0]) * background
    return linear(colour.clamp(0, 1)), visible_depth(image[0, ..., 3], opacity=opacity[0, ..., 0])


def linear(colour):
    """Splats are trained on photographs, so their colours are sRGB."""
    return torch.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def shaken(t_s):
    """World from camera: it trembles in the hand."""
    yaw = 0.03 * np.sin(2 * np.pi * 7 * t_s) + 0.015 * np.sin(2 * np.pi * 12 * t_s + 1)
    pitch = 0.02 * np.sin(2 * np.pi * 9 * t_s + 2)
    (a, b), (c, d) = (np.cos(yaw), np.sin(yaw)), (np.cos(pitch), np.sin(pitch))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[a, 0, b], [0, 1, 0], [-b, 0, a]]) @ np.array([[1, 0, 0], [0, c, -d], [0, d, c]])
    pose[:3, 3] = 0.08 * np.sin(2 * np.pi * 2 * t_s), 0.3 * t_s, 0
    return pose


def shake(seconds, width, height):
    """A lens, and poses at `POSES_HZ`."""
    lens = esaac.Intrinsics(0.9 * width, 0.9 * width, width / 2, height / 2, half_pixel_centres=True)
    times_s = np.arange(round(seconds * POSES_HZ) + 1) / POSES_HZ
    names = tuple(f"{t_s:.6f}" for t_s in times_s)
    return CameraPath(lens, width, height, np.stack([shaken(t_s) for t_s in times_s]), names)


def poses_per_frame(pose_hz, frame_hz):
    """Frames are drawn at poses, so each is so many poses after the one before."""
    if not frame_hz > 0 or round(pose_hz / frame_hz) * frame_hz != pose_hz:
        sys.exit(
            f"error: --rate is {frame_hz:g}, expected a number that divides the {pose_hz:g} poses a second"
        )
    return round(pose_hz / frame_hz)


def run(splats, path, pose_hz, frame_hz, **options):
    """Packets of frames at `frame_hz`, of poses at `pose_hz`."""
    options = {"width": path.width, "height": path.height, "intrinsics": path.lens, **options}
    camera = esaac.EventCamera("dvs128", **options)
    times_ns = np.round(np.arange(len(path)) / pose_hz * 1e9).astype(np.int64)
    poses, packets = path.poses(times_ns), []
    for index in range(0, len(path), poses_per_frame(pose_hz, frame_hz)):
        colour, depth = draw(splats, path.world_from_camera[index], path.lens, path.width, path.height)
        packets.append(camera.step(colour, t_ns=int(times_ns[index]), depth=depth, poses=poses))
    return camera.sensor, packets


def main(arguments=None):
    given = PARSER.parse_args(arguments)
    splats = read_splats(given.splats, given.device) if given.splats else own_scene(given.device)
    if given.path:
        path, pose_hz = CameraPath.read(given.path, dataparser=given.dataparser), given.rate
    else:
        path, pose_hz = shake(given.seconds, *given.size), POSES_HZ
    contrast = {"contrast_on": given.contrast, "contrast_off": given.contrast}
    sensor, packets = run(splats, path, pose_hz, given.rate, **contrast)
    print(f"{sum(map(len, packets))} events of {len(packets)} frames and {len(path)} poses")
    if given.out:
        with esaac.EventWriter(given.out, sensor) as writer:
            for packet in packets:
                writer.write(packet)


if __name__ == "__main__":
    main()
