"""Poses of matrices and of nerfstudio's files, and what conventions they have."""

import json

import numpy as np
import pytest

import esaac
from esaac.still import CameraPath, view_of, visible_depth

TIMES_NS = np.array([0, 10_000_000, 20_000_000])


def turn(axis, angle):
    """A rotation about one of the axes."""
    c, s = np.cos(angle), np.sin(angle)
    a, b = [other for other in range(3) if other != axis]
    made = np.eye(4)
    made[[a, a, b, b], [a, b, a, b]] = (c, -s, s, c) if axis != 1 else (c, s, -s, c)
    return made


def pose(place=(0, 0, 0), turned=None):
    made = np.eye(4) if turned is None else turned.copy()
    made[:3, 3] = place
    return made


def rotated(quaternion, points):
    x, w = quaternion[:3], quaternion[3]
    return points + 2 * np.cross(x, np.cross(x, points) + w * points)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, np.pi, -2.8, 3.1])
def test_a_matrix_and_its_pose_move_points_alike(axis, angle):
    matrix = pose((1, -2, 3), turn(axis, angle) @ turn((axis + 1) % 3, 0.4))
    given = np.stack([matrix, np.eye(4), matrix])
    poses = esaac.Poses.from_matrices(TIMES_NS, given, given[:, None], axes="usd")
    assert poses.camera.shape == (3, 1, 7) and poses.bodies.shape == (3, 1, 1, 7)
    points = np.random.default_rng(1).normal(size=(5, 3))
    for told in (poses.camera[0, 0], poses.bodies[2, 0, 0]):
        np.testing.assert_allclose(
            rotated(told[3:], points) + told[:3], points @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-12
        )
    np.testing.assert_allclose(poses.camera[1, 0], [0, 0, 0, 0, 0, 0, 1])
    three_rows = esaac.Poses.from_matrices(TIMES_NS, given[:, :3], axes="usd")
    np.testing.assert_array_equal(three_rows.camera, poses.camera)


def test_a_renderers_view_matrix_is_the_inverse_in_other_axes():
    matrix = pose((0.5, 0.2, 4), turn(1, 0.3) @ turn(0, -0.2))
    view = view_of(matrix)
    # One metre before the camera, one to the right and one up.
    ahead, right, up = (matrix @ (*point, 1) for point in ((0, 0, -1), (1, 0, 0), (0, 1, 0)))
    np.testing.assert_allclose(
        [view @ point for point in (ahead, right, up)],
        [(0, 0, 1, 1), (1, 0, 0, 1), (0, -1, 0, 1)],
        atol=1e-12,
    )
    back = esaac.Poses.from_matrices(TIMES_NS[:1], np.linalg.inv(view)[None], axes="opencv").camera
    same = esaac.Poses.from_matrices(TIMES_NS[:1], matrix[None], axes="opengl").camera
    # A quaternion and its negative are one turn.
    back[..., 3:] *= np.sign(back[..., 6:] * same[..., 6:])
    np.testing.assert_allclose(back, same, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        (np.diag([2, 2, 2, 1]), "scaled"),
        (2 * np.eye(4), "not affine"),
        (np.diag([1, 1, -1, 1]), "mirrored"),
        (np.full((4, 4), np.nan), "not finite"),
        (pose((1, 2, 3), turn(2, 0.3)).T, "transposed"),
        (np.eye(4) + np.eye(4, k=1) * [0, 0.5, 0, 0], "sheared"),
    ],
)
def test_matrices_that_are_not_rigid_are_named(wrong, fault):
    with pytest.raises(esaac.FrameError, match=rf"camera\[1\] is {fault}.*expected a rigid transform"):
        esaac.Poses.from_matrices(TIMES_NS, np.stack([np.eye(4), wrong, np.eye(4)]))
    with pytest.raises(esaac.FrameError, match=r"camera has shape \(3, 7\)"):
        esaac.Poses.from_matrices(TIMES_NS, np.zeros((3, 7)))


def transforms(**changes):
    """A file of three frames, not in the order of their names."""
    frames = [
        {"file_path": f"images/{name}.png", "transform_matrix": pose((k, 0, 4), turn(1, 0.1 * k)).tolist()}
        for name, k in (("b", 1), ("a", 0), ("c", 2))
    ]
    lens = {"fl_x": 50.0, "fl_y": 51.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48, "camera_model": "OPENCV"}
    return {**lens, "k1": 0.0, "frames": frames, **changes}


def written(folder, **changes):
    (folder / "transforms.json").write_text(json.dumps(transforms(**changes)))
    return folder / "transforms.json"


def test_nerfstudios_file_is_a_camera_path(tmp_path):
    written(tmp_path)
    path = CameraPath.read(tmp_path)
    assert path.names == ("images/a.png", "images/b.png", "images/c.png") and len(path) == 3
    assert path.lens == esaac.Intrinsics(50, 51, 32, 24, half_pixel_centres=True)
    assert (path.width, path.height) == (64, 48)
    poses = path.poses(TIMES_NS)
    np.testing.assert_allclose(poses.camera[:, 0, :3], [(0, 0, 4), (1, 0, 4), (2, 0, 4)])
    np.testing.assert_allclose(poses.camera[2, 0, 3:], [0, np.sin(0.1), 0, np.cos(0.1)], atol=1e-12)
    np.testing.assert_allclose(path.views()[0] @ (0, 0, 0, 1), (0, 0, 4, 1), atol=1e-12)
    fisheye = CameraPath.read(written(tmp_path, camera_model="OPENCV_FISHEYE"))
    assert fisheye.lens.projection == "fisheye"


def test_frames_are_in_the_order_of_their_numbers(tmp_path):
    names = [f"images/frame_{k}.png" for k in (0, 1, 2, 9, 10, 11, 100)] + ["images/left2_1.png"]
    huge = "9" * 5000
    names = ["8.png", "9.png", "10.png", "a007b.png", "a12.png", f"a{huge}.png", *names]
    mixed = np.random.default_rng(2).permutation(len(names))
    frames = [
        {"file_path": names[k], "transform_matrix": pose((float(k), 0, 0)).tolist()} for k in mixed.tolist()
    ]
    path = CameraPath.read(written(tmp_path, frames=frames))
    assert path.names == tuple(names)
    np.testing.assert_array_equal(path.world_from_camera[:, 0, 3], np.arange(len(names)))


def test_a_fisheye_of_instant_ngp_needs_a_camera_model_that_says_so(tmp_path):
    with pytest.raises(
        esaac.ArgumentError,
        match="`is_fisheye` is True and `camera_model` is OPENCV, expected OPENCV_FISHEYE",
    ):
        CameraPath.read(written(tmp_path, is_fisheye=True))
    told = transforms(is_fisheye=True)
    del told["camera_model"]
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    with pytest.raises(esaac.ArgumentError, match="transforms.json: .*`camera_model` is missing"):
        CameraPath.read(tmp_path)
    told = {"is_fisheye": True, "camera_model": "OPENCV_FISHEYE"}
    assert CameraPath.read(written(tmp_path, **told)).lens.projection == "fisheye"
    with pytest.raises(esaac.ArgumentError, match="distortion .k2 is 0.1."):
        CameraPath.read(written(tmp_path, **told, k2=0.1))
    assert CameraPath.read(written(tmp_path, is_fisheye=False)).lens.projection == "pinhole"


def test_a_trained_models_units_are_its_own(tmp_path):
    applied, trained = pose((0, 0, 1), turn(0, 0.5)), pose((3, 2, 1), turn(2, -0.4))
    written(tmp_path, applied_transform=applied[:3].tolist(), applied_scale=2.0)
    plain = CameraPath.read(tmp_path)
    # As nerfstudio saves it: of the reconstruction's own poses, before what was applied to them.
    told = {"transform": (trained @ applied)[:3].tolist(), "scale": 0.25 * 2.0}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(told))
    path = CameraPath.read(tmp_path, dataparser=tmp_path / "dataparser_transforms.json")
    expected = trained @ plain.world_from_camera
    expected[:, :3, 3] *= 0.25
    np.testing.assert_allclose(path.world_from_camera, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"k1": 0.1}, esaac.ArgumentError, "lens has distortion .k1 is 0.1."),
        ({"camera_model": "EQUIRECTANGULAR"}, esaac.ArgumentError, "is EQUIRECTANGULAR, expected OPENCV"),
        ({"frames": []}, esaac.ArgumentError, "no frames"),
        (
            {"frames": [{"file_path": "a", "transform_matrix": np.eye(4).tolist(), "fl_x": 3.0}]},
            esaac.ArgumentError,
            "frame a has its own `fl_x`",
        ),
        (
            {"frames": [{"file_path": "a", "transform_matrix": [[1, 2], [3, 4]]}]},
            esaac.ArgumentError,
            r"shape \(2, 2\)",
        ),
        (
            {"frames": [{"file_path": "a", "transform_matrix": [[1, 2], [3]]}]},
            esaac.ArgumentError,
            r"`transform_matrix` of frame a is \[\[1, 2\], \[3\]\], expected 4 rows of 4 numbers",
        ),
        ({"frames": [{"file_path": "a"}]}, esaac.ArgumentError, "frame a has no `transform_matrix`"),
        (
            {"frames": [{"transform_matrix": np.eye(4).tolist()}]},
            esaac.ArgumentError,
            "`file_path` of frame 0 is missing, expected a text",
        ),
        ({"frames": [{"file_path": 7}]}, esaac.ArgumentError, "`file_path` of frame 0 is 7, expected a text"),
        ({"frames": ["a"]}, esaac.ArgumentError, "frame 0 is a str, expected an object with `file_path`"),
        ({"frames": {"a": 1}}, esaac.ArgumentError, "`frames` is a dict, expected a list"),
        ({"fl_x": "50"}, esaac.ArgumentError, "`fl_x` is '50', expected a finite number"),
        ({"cx": None}, esaac.ArgumentError, "`cx` is None, expected a finite number"),
        ({"w": 64.5}, esaac.ArgumentError, "`w` is 64.5, expected a whole number of pixels"),
        ({"h": 0}, esaac.ArgumentError, "`h` is 0, expected a whole number of pixels, at least 1"),
        (
            {"frames": [{"file_path": "a", "transform_matrix": (2 * np.eye(4)).tolist()}]},
            esaac.FrameError,
            "expected a rigid transform",
        ),
    ],
)
def test_files_that_do_not_fit_are_told(tmp_path, changes, error, message):
    with pytest.raises(error, match=f"transforms.json.*{message}"):
        CameraPath.read(written(tmp_path, **changes))
    incomplete = transforms()
    del incomplete["fl_y"]
    (tmp_path / "transforms.json").write_text(json.dumps(incomplete))
    with pytest.raises(esaac.ArgumentError, match="has no `fl_y`"):
        CameraPath.read(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"frames": [', "is no JSON: Expecting value"),
        ("", "is no JSON"),
        ("[]", "holds a list, expected an object"),
        ("3", "holds a int, expected an object"),
    ],
)
def test_what_is_no_object_of_json_is_told(tmp_path, text, message):
    path, trained = written(tmp_path), tmp_path / "dataparser_transforms.json"
    trained.write_text(text)
    with pytest.raises(esaac.ArgumentError, match=f"dataparser_transforms.json {message}"):
        CameraPath.read(path, dataparser=trained)
    path.write_text(text)
    with pytest.raises(esaac.ArgumentError, match=f"/transforms.json {message}"):
        CameraPath.read(path)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"scale": 1.0}, "dataparser.json has no `transform`, expected transform, scale"),
        ({"transform": np.eye(4).tolist()}, "dataparser.json has no `scale`, expected transform, scale"),
        ({"transform": [1, 2], "scale": 1.0}, r"dataparser.json: `transform` has shape \(2,\)"),
        (
            {"transform": np.eye(4).tolist(), "scale": "1"},
            "dataparser.json: `scale` is '1', expected a finite",
        ),
    ],
)
def test_a_trained_models_file_that_does_not_fit_is_told(tmp_path, told, message):
    (tmp_path / "dataparser.json").write_text(json.dumps(told))
    with pytest.raises(esaac.ArgumentError, match=message):
        CameraPath.read(written(tmp_path), dataparser=tmp_path / "dataparser.json")


def test_depth_is_along_the_axis_and_nothing_is_infinitely_far():
    lens = esaac.Intrinsics(20, 20, 16, 12, half_pixel_centres=True)
    distance = 3 * lens.ray_lengths(32, 24)
    opacity = np.ones((24, 32), np.float32)
    opacity[:5], opacity[5] = 0.1, 0.5
    depth = visible_depth(distance, opacity=opacity, rays_of=lens)
    assert depth.dtype == np.float32 and not depth[:5].any()
    np.testing.assert_allclose(depth[5:], 3, rtol=1e-6)
    np.testing.assert_array_equal(visible_depth(distance), distance)
    # Where nothing was drawn, renderers divide 0 by 0.
    distance[:5] = np.nan
    np.testing.assert_array_equal(visible_depth(distance, opacity=opacity, rays_of=lens), depth)


def test_a_wall_that_a_path_passes_sends_the_events_of_its_motion(tmp_path):
    """The file's conventions, all the way to events: those of poses and of motion vectors are the same."""
    width, height, shift_m = 40, 24, 0.06
    frames = [{"file_path": f"{k}", "transform_matrix": pose((shift_m * k, 0, 2)).tolist()} for k in range(4)]
    lens = {"fl_x": 100.0, "fl_y": 100.0, "cx": 20.0, "cy": 12.0, "w": width, "h": height}
    path = CameraPath.read(written(tmp_path, frames=frames, **lens))
    times_ns = np.arange(4) * 33_000_000
    sensor = {"width": width, "height": height, "contrast_on": 0.15, "contrast_off": 0.15}
    by_path = esaac.EventCamera("dvs128", intrinsics=path.lens, synthesis="rigid", **sensor)
    by_motion = esaac.EventCamera("dvs128", synthesis="motion", **sensor)
    shift_px = 100 * shift_m / 2
    motion = np.zeros((height, width, 2), np.float32)
    # The camera moves right, so the wall came from the right.
    motion[..., 0] = shift_px
    for k, t_ns in enumerate(times_ns):
        row = 0.5 + 0.4 * np.sin((np.arange(width) + shift_px * k) / 3)
        hdr = np.broadcast_to(row[None, :, None], (height, width, 3)).astype(np.float32)
        depth = np.full((height, width), 2.0, np.float32)
        one = by_path.step(hdr, t_ns=int(t_ns), depth=depth, poses=path.poses(times_ns))
        other = by_motion.step(hdr, motion, t_ns=int(t_ns))
    assert len(other) > 200 and abs(len(one) - len(other)) < 0.02 * len(other)
    np.testing.assert_array_equal(one.x[:100], other.x[:100])
