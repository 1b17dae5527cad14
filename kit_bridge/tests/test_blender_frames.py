"""The parts of `blender_frames.py` that need no Blender: lens, poses, pass indices."""

import importlib.util
import pathlib
import sys
import types

import numpy as np
import pytest

PATH = pathlib.Path(__file__).parents[1] / "scripts" / "blender_frames.py"
SPEC = importlib.util.spec_from_file_location("blender_frames", PATH)
script = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(script)

SENSOR_MM = (36.0, 24.0)


def turn(axis, angle):
    """A rotation, by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def placed(linear, place):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, place
    return matrix


def lens(size_px, aspect=(1, 1), fit="AUTO", shift=(0, 0)):
    told = script.pinhole(size_px, aspect, 18.0, SENSOR_MM, fit, shift)
    return tuple(told[key] for key in ("fx", "fy", "cx", "cy"))


def test_the_longer_side_has_the_sensor_s_width():
    assert lens((160, 120)) == (80, 80, 79.5, 59.5)
    assert lens((120, 160)) == (80, 80, 59.5, 79.5)
    # Pixels twice as high as wide make this the higher image.
    assert lens((160, 120), aspect=(1, 2)) == (120, 60, 79.5, 59.5)
    assert lens((120, 160), fit="HORIZONTAL") == (60, 60, 59.5, 79.5)
    assert lens((160, 120), fit="VERTICAL") == (90, 90, 79.5, 59.5)


def test_a_shift_is_in_parts_of_the_fitted_side_and_moves_the_view():
    assert lens((160, 120), shift=(0.1, -0.05)) == pytest.approx((80, 80, 63.5, 51.5))
    assert lens((160, 120), shift=(0.1, -0.05), fit="VERTICAL") == pytest.approx((90, 90, 67.5, 53.5))
    assert lens((160, 120), shift=(0, 0.1), aspect=(1, 1.25)) == pytest.approx((80, 64, 79.5, 59.5 + 12.8))


def test_poses_reach_from_the_first_frame_to_the_last():
    assert script.pose_frames(5, 3, 30, 60) == [5, 5.5, 6, 6.5, 7]
    assert script.pose_frames(1, 3, 24, 960)[-1] == pytest.approx(3)
    assert len(script.pose_frames(1, 3, 24, 960)) == 81
    # Thirds of 30000/1001 are no sums of floats.
    assert len(script.pose_frames(1, 100, 30000 / 1001, 90000 / 1001)) == 298
    # Poses that miss the frames: one beyond the last.
    assert script.pose_frames(0, 3, 30, 25) == pytest.approx([0, 1.2, 2.4])
    assert script.split_frame(4 - 1e-9) == (4, 0.0)
    assert script.split_frame(4.25) == (4, 0.25)
    assert script.split_frame(-0.75) == (-1, 0.25)


SHAPES = {
    "as it is": np.eye(3),
    "stretched": np.diag([1, 0.6, 1.4]),
    "sheared": np.array([[1, 0.5, 0], [0, 1, 0], [0, 0.2, 2]]),
    "mirrored": np.diag([-1, 1, 2]),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_poses_move_every_point_as_the_matrices_do(shape):
    matrices = [placed(turn((1, 2, 3), 0.3 * k) @ shape, (k, 2, -k)) for k in range(5)]
    poses = script.rigid_poses(np.asarray(matrices, np.float32))
    for matrix, pose in zip(matrices, poses):
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose) > 0 and (pose[3] == (0, 0, 0, 1)).all()
        for point in np.eye(3):
            first = matrices[0] @ (*point, 1)
            assert np.allclose(pose @ np.linalg.inv(poses[0]) @ first, matrix @ (*point, 1), atol=1e-5)


def test_a_body_that_has_no_scale_keeps_its_axes():
    matrices = np.array([placed(turn((0, 0, 1), 0.4 * k), (1, k, 0)) for k in range(3)])
    assert np.allclose(script.rigid_poses(matrices), matrices, atol=1e-12)


def test_what_is_not_rigid_has_no_poses():
    grows = [np.diag([1 + 0.01 * k] * 3 + [1]) for k in range(3)]
    shears = [placed([[1, 0.01 * k, 0], [0, 1, 0], [0, 0, 1]], (0, 0, 0)) for k in range(3)]
    turns_inside_out = [np.eye(4), np.diag([-1.0, 1, 1, 1])]
    flat = [placed(np.diag([1, 1, 0]), (k, 0, 0)) for k in range(3)]
    for matrices in (grows, shears, turns_inside_out, flat):
        assert script.rigid_poses(matrices) is None
    assert script.rigid_poses(flat[:1] * 3) is not None, "a flat body that stands still"


def test_what_stands_still_does_so_within_single_precision():
    far = placed(np.eye(3), (1000, 0, 0))
    assert script.is_still([far, far + 1e-5]) and not script.is_still([far, far + 0.01])
    assert not script.is_still([np.eye(4), placed(np.eye(3), (0, 1e-4, 0))])


def test_own_pass_indices_are_kept_where_they_are_unique():
    given = {"wall": 0, "ball": 0, "box": 3, "left": 1, "right": 1, "lamp": 2}
    chosen = script.pass_indices(given, needed={"ball", "box", "left"})
    # `left` and `right` share 1, so that it is free.
    assert chosen == {"wall": 0, "ball": 1, "box": 3, "left": 4, "right": 0, "lamp": 2}


def test_more_bodies_than_indices_are_refused(monkeypatch):
    monkeypatch.setattr(script, "MOST_INDEX", 2)
    names = dict.fromkeys("abc", 0)
    with pytest.raises(script.Unfit, match="3 objects move, expected at most 2"):
        script.pass_indices(names, set(names))


def test_arguments_come_after_two_dashes_in_blender(monkeypatch):
    blender = ["blender", "s.blend", "--background", "--python", "blender_frames.py", "--", "--out", "a"]
    monkeypatch.setattr(sys, "argv", blender)
    assert script.told().out == pathlib.Path("a")
    monkeypatch.setattr(sys, "argv", ["blender_frames.py", "--out", "b", "--pose-rate", "480"])
    assert (script.told().out, script.told().pose_rate) == (pathlib.Path("b"), 480)


class Stage:
    """A scene of Blender, as far as a survey looks at it: a bent sheet, and a ball of which a copy flies."""

    def __init__(self, deforms_at):
        self.now, self.deforms_at = 0.0, deforms_at
        self.camera, self.depsgraph = Thing(self, "eye"), self
        self.objects = [Thing(self, "sheet", [object()]), Thing(self, "ball")]

    def frame_set(self, whole, subframe):
        self.now = whole + subframe

    @property
    def object_instances(self):
        matrix = placed(np.eye(3), (self.now, 0, 0))
        made = types.SimpleNamespace(object=self.objects[1], is_instance=True, parent=None)
        made.persistent_id, made.matrix_world = (1,), matrix
        return [made]


class Thing:
    type, animation_data, hide_render, parent_type, pass_index = "MESH", None, False, "OBJECT", 0
    matrix_world = np.eye(4)

    def __init__(self, stage, name, modifiers=()):
        self.stage, self.name_full, self.modifiers = stage, name, modifiers
        self.data = types.SimpleNamespace(animation_data=None)

    @property
    def original(self):
        return self

    def evaluated_get(self, graph):
        return self

    def to_mesh(self):
        bent = self.stage.now == self.stage.deforms_at
        return types.SimpleNamespace(vertices=Points([0, 0, 1 + bent]))

    def to_mesh_clear(self):
        pass


class Points(list):
    def __len__(self):
        return 1

    def foreach_get(self, name, into):
        into[:] = list(self)


@pytest.mark.parametrize("key_rate_hz", [24.0, 25.0, 30000 / 1001, 50.0])
def test_what_bends_or_is_copied_is_seen_in_frames_that_the_poses_miss(monkeypatch, key_rate_hz):
    monkeypatch.setattr(script, "lens_of", lambda scene, eye: {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0})
    frames = range(1, 6)
    poses = script.pose_frames(1, len(frames), key_rate_hz, 960.0)
    stage = Stage(deforms_at=4)
    _, eyes, drawn = script.survey(stage, stage, frames, poses)
    assert len(eyes) == len(poses) == len(drawn["sheet"].matrices)
    assert drawn["sheet"].deforms
    (seen,) = drawn["ball"].copies.values()
    assert len(seen) == len(frames) and not drawn["ball"].is_still(len(frames))
    instances = script.instances_of(drawn, len(frames))
    assert instances == {}, "both move and have no poses"


def test_copies_that_stand_still_need_no_index_whatever_the_rate(monkeypatch):
    monkeypatch.setattr(script, "lens_of", lambda scene, eye: {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0})
    monkeypatch.setattr(Stage, "object_instances", property(lambda stage: [still]))
    stage, frames = Stage(deforms_at=None), range(1, 6)
    still = types.SimpleNamespace(object=stage.objects[1], is_instance=True, parent=None)
    still.persistent_id, still.matrix_world = (1,), np.eye(4)
    _, _, drawn = script.survey(stage, stage, frames, script.pose_frames(1, 5, 25.0, 960.0))
    assert all(one.is_still(len(frames)) for one in drawn.values())
