"""Events of Gaussian splats, with a renderer of the tests in the place of gsplat, which needs a GPU."""

import json
import sys

import numpy as np
import plyfile
import pytest
import rigid_numpy
import splats
import torch

import esaac


@pytest.fixture(scope="module")
def program():
    sys.modules["gsplat"] = splats
    import gsplat_events

    yield gsplat_events
    del sys.modules["gsplat"], sys.modules["gsplat_events"]


SIZE = 48, 36
CONTRAST = {"contrast_on": 0.15, "contrast_off": 0.15}


def events_of(program, frame_hz, synthesis):
    path = program.shake(0.1, *SIZE)
    scene = program.own_scene("cpu")
    _, packets = program.run(scene, path, program.POSES_HZ, frame_hz, synthesis=synthesis, **CONTRAST)
    return tuple(
        np.concatenate([getattr(packet, name) for packet in packets]) for name in ("x", "y", "t_ns", "p")
    )


def test_events_follow_the_cameras_path_between_rare_frames(program):
    truth = events_of(program, program.POSES_HZ, "linear")
    rigid = rigid_numpy.f1(events_of(program, 30, "rigid"), truth)
    blended = rigid_numpy.f1(events_of(program, 30, "linear"), truth)
    # The rim of the image is new at every frame, and edges of splats have no depth of their own.
    assert len(truth[0]) > 2000 and rigid > 0.65 and rigid > blended + 0.4, (rigid, blended)


def test_depth_without_a_surface_is_0_whatever_it_was():
    depth = torch.tensor([[torch.nan, torch.inf, 2.0, 3.0]])
    seen = esaac.still.visible_depth(depth, opacity=torch.tensor([[0.0, 0.1, 0.5, 1.0]]))
    assert seen.dtype == torch.float32 and seen.tolist() == [[0, 0, 2, 3]]


def test_depth_and_poses_predict_the_next_image(program):
    """What the path and depth say of a pixel is where the renderer draws it: the conventions of both agree."""
    path, scene = program.shake(0.1, *SIZE), program.own_scene("cpu")
    drawn = [program.draw(scene, path.world_from_camera[index], path.lens, *SIZE) for index in (0, 12)]
    (_, _, fx, _), (cx, cy) = path.lens.told()[:4], (SIZE[0] / 2, SIZE[1] / 2)
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    depth = drawn[0][1].numpy().astype(float)
    rays = np.stack([(x - cx) / fx, -(y - cy) / fx, -np.ones_like(x)], axis=-1)
    points = np.concatenate([depth[..., None] * rays, np.ones((*depth.shape, 1))], axis=-1)
    there = points @ (np.linalg.inv(path.world_from_camera[12]) @ path.world_from_camera[0]).T
    u, v = cx - fx * there[..., 0] / there[..., 2], cy + fx * there[..., 1] / there[..., 2]
    inside = (u > 2) & (u < SIZE[0] - 2) & (v > 2) & (v < SIZE[1] - 2)
    columns, rows = (u[inside] - 0.5).round().astype(int), (v[inside] - 0.5).round().astype(int)
    before, after = (image.mean(dim=-1).numpy() for image, _ in drawn)
    moved = np.abs(after[rows, columns] - before[inside]).mean()
    still = np.abs(after - before)[inside].mean()
    assert np.hypot(u - x, v - y)[inside].mean() > 1.0 and moved < 0.5 * still


def test_a_file_of_splats_and_a_path_become_a_recording(program, tmp_path):
    scene = program.own_scene("cpu")
    columns = [
        *zip("xyz", scene["means"].T),
        *((f"f_dc_{channel}", scene["colors"][:, 0, channel]) for channel in range(3)),
        ("opacity", scene["opacities"].logit()),
        *((f"scale_{axis}", scene["scales"][:, axis].log()) for axis in range(3)),
        # Any length stands for the same turn.
        *((f"rot_{number}", 3 * scene["quats"][:, number]) for number in range(4)),
    ]
    vertices = np.zeros(len(scene["means"]), [(name, "<f4") for name, _ in columns])
    for name, values in columns:
        vertices[name] = values
    plyfile.PlyData([plyfile.PlyElement.describe(vertices, "vertex")]).write(tmp_path / "splats.ply")
    read = program.read_splats(tmp_path / "splats.ply", "cpu")
    for name, values in scene.items():
        torch.testing.assert_close(read[name], values, atol=1e-5, rtol=1e-5)
    path = program.shake(0.1, *SIZE)
    frames = [
        {"file_path": f"{index:04}.png", "transform_matrix": path.world_from_camera[index].tolist()}
        for index in range(0, 49, 16)
    ]
    lens = {"fl_x": path.lens.fx, "fl_y": path.lens.fy, "cx": path.lens.cx, "cy": path.lens.cy}
    told = {**lens, "w": SIZE[0], "h": SIZE[1], "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    program.main(
        [
            *("--splats", str(tmp_path / "splats.ply"), "--path", str(tmp_path / "transforms.json")),
            *("--device", "cpu", "--out", str(tmp_path / "events.h5")),
        ]
    )
    _, _, t_ns, _ = esaac.files.load_dsec(tmp_path / "events.h5")
    assert len(t_ns) > 300 and 0 < t_ns.min() and t_ns.max() <= 100_000_000
    program.main(["--device", "cpu", "--seconds", "0.07", "--size", "32", "24", "--rate", "60"])


@pytest.mark.parametrize("rate", ["50", "1000", "0", "-30", "nan"])
def test_a_rate_of_frames_that_have_no_pose_is_refused(program, rate):
    with pytest.raises(SystemExit, match=f"--rate is {rate}, expected a number that divides the 480 poses"):
        program.main(["--device", "cpu", "--size", "32", "24", "--rate", rate])
