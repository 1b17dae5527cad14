"""`esaac.ovrtx` with a stand-in for ovrtx (`stand_ins/ovrtx.py`)."""

import numpy as np
import ovrtx
import pytest
from conftest import FRAME_NS, assert_same, bars, join

import esaac
from esaac.ovrtx import EventCamera

PRODUCT = "/Render/Camera"
SENSOR = {"width": 40, "height": 24, "contrast_on": 0.15, "contrast_off": 0.15}
LENS = esaac.Intrinsics(50, 50, 20, 12, half_pixel_centres=True)


def images(index, names="/Render/Camera/Vars/", depth_type=np.float32):
    """As ovrtx draws them: halves, four channels of motion of which two count, depth with an axis of length 1."""
    hdr, motion = bars(40, 24, index, dtype=np.float16)
    vectors = np.concatenate([motion, np.full((24, 40, 2), 99, np.float32)], axis=-1)
    depth = np.full((24, 40, 1), 2.0, np.float32).view(depth_type)
    ids = np.zeros((24, 40, 1), np.uint32)
    drawn = (hdr, vectors, depth, ids)
    sources = ("HdrColor", "TargetMotionSD", "DistanceToImagePlaneSD", "NonStableInstanceSegmentation")
    return {names + source: image for source, image in zip(sources, drawn)}


def poses(count):
    """A wall 2 m away that passes by 2 px a frame: the camera moves left."""
    camera = np.zeros((count, 7)) + [0, 0, 0, 0, 0, 0, 1]
    camera[:, 0] = -2.0 / 50 * 2 * np.arange(count)
    return esaac.Poses(np.arange(count) * FRAME_NS, camera)


def run(camera, renderer, count=4, given=None):
    packets = []
    for index in range(count):
        products = renderer.step(render_products={PRODUCT}, delta_time=1 / 60)
        packets.append(camera.step(products, t_ns=FRAME_NS * index, poses=given))
    return join(packets)


def expected(count=4, given=None, **options):
    camera, packets = esaac.EventCamera("dvs128", **SENSOR, **options), []
    for index in range(count):
        hdr, vectors, depth, ids = images(index).values()
        geometry = {} if given is None else {"depth": depth[..., 0], "ids": ids[..., 0], "poses": given}
        packets.append(camera.step(hdr, vectors[..., :2], t_ns=FRAME_NS * index, **geometry))
    return join(packets)


@pytest.mark.parametrize("on_gpu", [True, False])
def test_events_are_those_of_the_images_once_they_are_there(on_gpu):
    renderer = ovrtx.Renderer(PRODUCT, images)
    with EventCamera(PRODUCT, "dvs128", on_gpu=on_gpu, **SENSOR) as camera:
        assert_same(run(camera, renderer), expected())
        assert camera.events.synthesis == "motion"


def test_time_is_the_simulations_and_not_the_renderers():
    renderer = ovrtx.Renderer(PRODUCT, images)
    _, _, t_ns, _ = run(EventCamera(PRODUCT, "dvs128", **SENSOR), renderer)
    # The renderer believes that half of the time has passed.
    assert t_ns.max() > 1e9 * renderer.time_s and t_ns.max() <= 3 * FRAME_NS


@pytest.mark.parametrize("depth_type", [np.float32, np.uint32])
def test_depth_and_poses_give_exact_paths(depth_type):
    renderer = ovrtx.Renderer(PRODUCT, lambda index: images(index, depth_type=depth_type))
    camera = EventCamera(PRODUCT, "dvs128", intrinsics=LENS, **SENSOR)
    assert_same(run(camera, renderer, given=poses(4)), expected(given=poses(4), intrinsics=LENS))
    assert camera.events.synthesis == "rigid" and not camera.events.statistics["without_poses"]


def test_names_of_older_versions_and_of_other_prims_are_found():
    older = ovrtx.Renderer(PRODUCT, lambda index: images(index, names=""))
    assert_same(run(EventCamera(PRODUCT, "dvs128", **SENSOR), older), expected())

    def renamed(index):
        return {f"/R/{number}": image for number, image in enumerate(images(index).values())}

    paths = {"HdrColor": "/R/0", "TargetMotionSD": "/R/1"}
    camera = EventCamera(PRODUCT, "dvs128", variables=paths, **SENSOR)
    assert_same(run(camera, ovrtx.Renderer(PRODUCT, renamed)), expected())
    with pytest.raises(esaac.FrameError, match=r"has the render variables \['/R/0', .*tell it by variables="):
        run(EventCamera(PRODUCT, "dvs128", **SENSOR), ovrtx.Renderer(PRODUCT, renamed))
    with pytest.raises(esaac.ArgumentError, match="variables has `LdrColor`, expected HdrColor"):
        EventCamera(PRODUCT, "dvs128", variables={"LdrColor": "/R/0"}, **SENSOR)


@pytest.mark.parametrize("check_every", [1, 2, 20])
@pytest.mark.parametrize("by_poses", [True, False])
def test_a_renderer_that_freezes_is_told(check_every, by_poses, monkeypatch):
    monkeypatch.setattr(ovrtx.Renderer, "FRAMES_UNTIL_ECO", 25)

    def drawn(index):
        all_of_them = images(index)
        if by_poses:
            del all_of_them["/Render/Camera/Vars/TargetMotionSD"]
        return all_of_them

    def camera():
        return EventCamera(PRODUCT, "dvs128", intrinsics=LENS, check_every=check_every, **SENSOR)

    given = poses(45) if by_poses else None
    with pytest.raises(esaac.FrameError, match="same image while something moves.*ecoMode:enabled = false"):
        run(camera(), ovrtx.Renderer(PRODUCT, drawn), count=45, given=given)
    run(camera(), ovrtx.Renderer(PRODUCT, drawn, eco_mode=False), count=45, given=given)


def test_a_still_scene_may_be_drawn_alike():
    def still(_index):
        return {name: image for name, image in images(0).items() if name.endswith("HdrColor")}

    camera = EventCamera(PRODUCT, "dvs128", check_every=2, **SENSOR)
    for index in range(6):
        products = ovrtx.Renderer(PRODUCT, still).step({PRODUCT}, 1 / 60)
        assert len(camera.step(products, t_ns=FRAME_NS * index)) == 0


def test_what_is_missing_is_told():
    camera = EventCamera(PRODUCT, "dvs128", intrinsics=LENS, **SENSOR)
    products = ovrtx.Renderer(PRODUCT, images).step({PRODUCT}, 1 / 60)
    with pytest.raises(esaac.FrameError, match="no render product /Render/Other among .*'/Render/Camera'"):
        EventCamera("/Render/Other", "dvs128", **SENSOR).step(products, t_ns=0)
    del products[PRODUCT].frames[0].render_vars["/Render/Camera/Vars/DistanceToImagePlaneSD"]
    with pytest.raises(esaac.FrameError, match="no DistanceToImagePlaneSD, which poses need"):
        camera.step(products, t_ns=0, poses=poses(2))
    products[PRODUCT].frames.clear()
    with pytest.raises(esaac.FrameError, match="has no frame"):
        camera.step(products, t_ns=0)
    with pytest.raises(esaac.ArgumentError, match="check_every is -1"):
        EventCamera(PRODUCT, "dvs128", check_every=-1, **SENSOR)
    with pytest.raises(AttributeError, match=r"`contrast_on` is a parameter .*camera\.events\.sensor ="):
        camera.contrast_on = 0.4
    # A frame that fails leaves nothing mapped, and the camera goes on.
    products = ovrtx.Renderer(PRODUCT, images).step({PRODUCT}, 1 / 60)
    small = EventCamera(PRODUCT, "dvs128", width=32, height=24)
    for _ in range(2):
        with pytest.raises(esaac.FrameError, match="shape"):
            small.step(products, t_ns=0)
    assert len(camera.step(products, t_ns=0)) == 0
    camera.reset()
