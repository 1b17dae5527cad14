"""What steps warn of besides poses: input that must send false events, and light. Once for each camera."""

import warnings

import numpy as np
import pytest
from conftest import FRAME_NS

import esaac

WIDTH, HEIGHT = 64, 48
# No place is like another.
TEXTURE = np.random.default_rng(7).uniform(0.1, 1.0, (HEIGHT, 400)).astype(np.float32)


def camera(**options):
    return esaac.EventCamera("dvs128", width=WIDTH, height=HEIGHT, **options)


def warned(kind, call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [w for w in caught if w.category is kind]


def view(index, shift_px=2):
    """A texture that moves right by `shift_px` a frame, and its motion vectors."""
    first = 200 - shift_px * index
    hdr = TEXTURE[:, first : first + WIDTH, None].repeat(3, 2)
    return hdr, np.full((HEIGHT, WIDTH, 2), (-shift_px, 0), np.float32)


def run(cam, shift_px, with_motion=False, frames=8, after=lambda _: None):
    for index in range(frames):
        hdr, motion = view(index, shift_px)
        cam.step(hdr, motion if with_motion else None, t_ns=index * FRAME_NS)
        after(cam)


def test_fast_motion_that_nothing_tells_is_warned_of_once():
    cam = camera()
    (warning,) = warned(esaac.InputWarning, lambda: run(cam, 5, frames=24))
    assert "camera 0: part of the image moves by 5.0 px a frame or more" in str(warning.message)
    assert "blended frames show it at two places at once" in str(warning.message)
    assert warning.filename == __file__ and cam.synthesis == "linear"
    assert not warned(esaac.InputWarning, lambda: run(camera(), 5, frames=4)), "too few frames to tell"
    assert not warned(esaac.InputWarning, lambda: run(camera(), 1))
    assert not warned(esaac.InputWarning, lambda: run(camera(), 5, with_motion=True))
    # Frames after a reset do not follow those before.
    assert not warned(esaac.InputWarning, lambda: run(camera(), 5, after=lambda cam: cam.reset()))


def test_vectors_that_shake_are_warned_of():
    def shake(cam):
        for index in range(8):
            hdr, motion = view(index)
            cam.step(hdr, motion * (-4 if index % 2 else 4), t_ns=index * FRAME_NS)

    (warning,) = warned(esaac.InputWarning, lambda: shake(camera()))
    assert "what moves leaves a parabola through three frames" in str(warning.message)


def test_a_synthesis_that_changes_is_looked_at_anew():
    cam = camera()

    def change():
        run(cam, 5, with_motion=True, frames=3)
        cam.sensor = cam.sensor.replace(synthesis="linear")
        for index in range(3, 9):
            cam.step(*view(index, 5), t_ns=index * FRAME_NS)

    (warning,) = warned(esaac.InputWarning, change)
    assert "moves by 5.0 px" in str(warning.message)


def test_of_environments_the_first_is_looked_at_and_of_a_rig_every_camera():
    def tiled(fast):
        with esaac.TiledEventCamera("dvs128", 2, width=WIDTH, height=HEIGHT) as envs:
            for index in range(6):
                frames = [view(index, 5 if env == fast else 0)[0] for env in range(2)]
                envs.submit(np.stack(frames), t_ns=index * FRAME_NS)
                envs.packet()

    assert len(warned(esaac.InputWarning, lambda: tiled(fast=0))) == 1
    assert not warned(esaac.InputWarning, lambda: tiled(fast=1))
    rig = esaac.Rig([camera().sensor] * 3)

    def together():
        for index in range(6):
            rig.step([view(index, shift)[0] for shift in (0, 5, 5)], index * FRAME_NS)

    (warning,) = warned(esaac.InputWarning, together)
    assert str(warning.message).startswith("camera 1 (and 1 others): part of the image moves")


def test_pixels_without_a_path_and_without_vectors_are_warned_of_once():
    lens = (60, 60, 31.5, 23.5)
    still = [esaac.Poses([0], [[[0, 0, 0, 0, 0, 0, 1]] * cameras]) for cameras in (1, 2)]

    def given(depth_m, unknown_id):
        """This depth, and this id that no body has, at every other column."""
        depth, ids = np.full((HEIGHT, WIDTH), 3, np.float32), np.zeros((HEIGHT, WIDTH), np.uint32)
        depth[:, ::2], ids[:, ::2] = depth_m, unknown_id
        return depth, ids

    def run_with(planes, motion=None):
        cam, (depth, ids) = camera(intrinsics=lens), planes
        for index in range(6):
            cam.step(view(index)[0], motion, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=still[0])
        assert cam.synthesis == "rigid"

    (warning,) = warned(esaac.InputWarning, lambda: run_with(given(3.0, 7)))
    assert "camera 0: 50% of the pixels have the id of a body without poses" in str(warning.message)
    assert warning.filename == __file__
    (warning,) = warned(esaac.InputWarning, lambda: run_with(given(np.nan, 0)))
    assert "50% of the pixels have a depth that is NaN, negative or too small to invert" in str(
        warning.message
    )
    assert not warned(esaac.InputWarning, lambda: run_with(given(np.inf, 0)))
    # With motion vectors they are what the pixels of a body without poses follow.
    unmoved = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    assert not warned(esaac.InputWarning, lambda: run_with(given(3.0, 7), unmoved))

    def tiled():
        with esaac.TiledEventCamera("dvs128", 2, width=WIDTH, height=HEIGHT, intrinsics=lens) as envs:
            depth, ids = (np.stack([plane] * 2) for plane in given(3.0, 7))
            for index in range(3):
                hdr = np.stack([view(index)[0]] * 2)
                envs.submit(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=still[1])
                envs.packet()

    assert len(warned(esaac.InputWarning, tiled)) == 1


def test_poses_of_frames_alone_are_warned_of_where_the_camera_shakes():
    def shaken(poses_per_frame):
        """A camera that looks to and fro at 11 Hz, some pixels a frame."""
        cam, depth = camera(intrinsics=(200, 200, 31.5, 23.5)), np.full((HEIGHT, WIDTH), 3, np.float32)
        for index in range(18):
            times_ns = (index - 1) * FRAME_NS + np.arange(poses_per_frame + 1) * FRAME_NS // poses_per_frame
            half = 0.015 * np.sin(2 * np.pi * 11 * times_ns * 1e-9)
            poses = np.zeros((len(times_ns), 1, 7))
            poses[:, 0, 4], poses[:, 0, 6] = np.sin(half), np.cos(half)
            cam.step(view(0)[0], t_ns=index * FRAME_NS, depth=depth, poses=esaac.Poses(times_ns, poses))

    (warning,) = warned(esaac.InputWarning, lambda: shaken(1))
    assert "the camera has a pose each 33.3 ms" in str(warning.message)
    assert not warned(esaac.InputWarning, lambda: shaken(8))


def test_light_is_warned_of_once_for_each_kind():
    bright = np.full((16, 32, 4), 10.0, np.float32)
    sensor = esaac.SensorModel("hd", pixel="physical", width=32, height=16, synthesis="linear")
    cam = esaac.EventCamera(sensor)
    step = lambda first, last: [cam.step(bright, t_ns=k * 50_000_000) for k in range(first, last)]
    (warning,) = warned(esaac.LightWarning, lambda: step(0, 6))
    assert "camera 0: `hd` is fitted to noise at 0.15 to 20 focal-plane lux" in str(warning.message)
    assert str(warning.message) == f"camera 0: {cam.light_warnings[0][0]}"
    cam.sensor = sensor.replace(flicker_depth=0.5, flicker_hz=900.0)
    (warning,) = warned(esaac.LightWarning, lambda: step(6, 9))
    assert "needs 360 sub-steps" in str(warning.message) and len(cam.light_warnings[0]) == 2
    dim = esaac.EventCamera(sensor)
    assert not warned(esaac.LightWarning, lambda: dim.step(bright * 0.01, t_ns=0))


def test_a_warning_that_is_made_an_error_leaves_the_packet():
    cam = camera()
    with warnings.catch_warnings():
        warnings.simplefilter("error", esaac.InputWarning)
        with pytest.raises(esaac.InputWarning):
            run(cam, 5)
    assert len(cam.last_packet) > 100
