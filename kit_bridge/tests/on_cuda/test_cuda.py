"""CUDA arrays in and tensors out. Needs an NVIDIA GPU that Vulkan sees, torch, CuPy, JAX and Warp; run by name:

python -m pytest kit_bridge/tests/on_cuda
"""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from conftest import FRAME_NS, assert_same, bars, run

import esaac

SIZE = {"width": 40, "height": 24, "contrast_on": 0.15, "contrast_off": 0.15}


def camera(**parameters):
    return esaac.EventCamera("dvs128", **{"device": "cuda:0", **SIZE, **parameters})


def cuda(array):
    return torch.from_numpy(np.ascontiguousarray(array)).cuda()


def on_host(packet):
    if hasattr(packet.x, "numpy"):
        columns = packet.x.numpy(), packet.y.numpy(), packet.t_ns.numpy(), packet.p.numpy()
        return columns[0].astype(np.uint16), columns[1].astype(np.uint16), columns[2], columns[3]
    return packet.x, packet.y, packet.t_ns, packet.p


def events(cam, change, count=5):
    packets = []
    for index in range(count):
        hdr, motion = change(*bars(40, 24, index))
        packets.append(on_host(cam.step(hdr, motion, t_ns=FRAME_NS * index)))
    return tuple(np.concatenate([packet[i] for packet in packets]) for i in range(4))


@pytest.mark.parametrize("packets", ["host", "mapped", "cuda"])
def test_torch_tensors_never_touch_the_host_and_give_the_same_bits(packets):
    expected = run(camera(), count=5)
    cam = camera(packets=packets)
    assert_same(events(cam, lambda hdr, motion: (cuda(hdr), cuda(motion))), expected)
    assert cam.statistics["host_copies"] == 0 and cam.statistics["device_copies"] == 10


def test_tensors_of_every_kind_are_taken_or_it_is_told_why_not():
    expected = run(camera(), count=5)
    kinds = {
        "a subclass": lambda array: torch.nn.Parameter(cuda(array), requires_grad=False),
        "on the host": torch.from_numpy,
        "pinned there": lambda array: torch.from_numpy(array).pin_memory(),
    }
    for kind in kinds.values():
        change = lambda hdr, motion, kind=kind: (kind(hdr), kind(motion))
        assert_same(events(camera(), change), expected)
    hdr, motion = map(cuda, bars(40, 24, 0))
    with pytest.raises(BufferError, match="gradient"):
        camera().step(hdr.requires_grad_(), motion, t_ns=0)


def test_layouts_make_no_difference():
    half = lambda array: array.astype(np.float16)
    expected = events(camera(), lambda hdr, motion: (half(hdr), motion))
    four = lambda motion: np.concatenate([motion, motion * 7], axis=2)
    padded = lambda array: torch.nn.functional.pad(cuda(array), (0, 0, 0, 3))[:, : array.shape[1]]
    changes = {
        "view of three channels": lambda hdr, motion: (cuda(half(hdr))[..., :3], cuda(motion)),
        "three channels": lambda hdr, motion: (cuda(half(hdr)[..., :3]), cuda(motion)),
        "four of motion": lambda hdr, motion: (cuda(half(hdr)), cuda(four(motion))),
        "view of two of four": lambda hdr, motion: (cuda(half(hdr)), cuda(four(motion))[..., :2]),
        "three of motion": lambda hdr, motion: (cuda(half(hdr)), cuda(four(motion)[..., :3])),
        "padded rows": lambda hdr, motion: (padded(half(hdr)), padded(motion)),
    }
    for what, change in changes.items():
        actual = events(camera(), change)
        assert all((a == e).all() for a, e in zip(actual, expected)), what


def test_strides_that_a_copy_cannot_take_say_so():
    hdr, motion = bars(40, 24, 0)
    for wrong, message in (
        (cuda(hdr).transpose(0, 1).contiguous().transpose(0, 1), "make it contiguous"),
        (cuda(hdr)[..., :1], "one channel"),
        (cuda(hdr).double(), "float64"),
        (cuda(hdr).bfloat16(), "bfloat16"),
        (cuda(hdr)[:-1], "hdr has shape"),
    ):
        with pytest.raises(esaac.FrameError, match=message):
            camera().step(wrong, cuda(motion), t_ns=0)
    with pytest.raises(esaac.FrameError, match="hdr lies on a CUDA device and motion on the host"):
        camera().step(cuda(hdr), motion, t_ns=0)


def late(stream, hdr, motion):
    """A frame whose colour is still being made, in `stream`."""
    hdr, motion = cuda(hdr), cuda(motion)
    big = torch.randn(4096, 4096, device="cuda")
    made = torch.zeros_like(hdr)
    torch.cuda.synchronize()
    with torch.cuda.stream(stream):
        for _ in range(20):
            big @ big
        made.copy_(hdr)
    return made, motion


@pytest.mark.parametrize("packets", ["host", "mapped", "cuda"])
def test_tensors_of_a_submitted_step_may_be_written_again_in_their_stream(packets):
    expected = run(camera(), count=5)
    cam, parts = camera(packets=packets), []
    given = tuple(map(cuda, bars(40, 24, 0)))
    for index in range(5):
        for tensor, array in zip(given, bars(40, 24, index)):
            tensor.copy_(cuda(array))
        cam.submit(*given, t_ns=FRAME_NS * index)
        for tensor in given:
            tensor.fill_(7.0)
        parts.append(tuple(np.array(column) for column in on_host(cam.packet())))
    assert_same(tuple(np.concatenate([part[i] for part in parts]) for i in range(4)), expected)
    assert cam.statistics["host_copies"] == 0


def test_submitted_frames_of_another_stream_are_waited_for():
    expected, side = run(camera(), count=5), torch.cuda.Stream()
    cam, parts = camera(), []
    for index in range(5):
        made, motion = late(side, *bars(40, 24, index))
        cam.submit(made, motion, t_ns=FRAME_NS * index, stream=side.cuda_stream)
        with torch.cuda.stream(side):
            made.zero_()
        parts.append(on_host(cam.packet()))
    assert_same(tuple(np.concatenate([part[i] for part in parts]) for i in range(4)), expected)


def test_streams_are_ordered():
    """Frames that are still being made when step is called are waited for."""
    expected = run(camera(), count=5)
    side = torch.cuda.Stream()
    slow = lambda hdr, motion: late(side, hdr, motion)

    def by_dlpack(hdr, motion):
        frame = slow(hdr, motion)
        torch.cuda.set_stream(side)
        return frame

    try:
        assert_same(events(camera(), by_dlpack), expected)
    finally:
        torch.cuda.set_stream(torch.cuda.default_stream())
    cam, packets = camera(), []
    for index in range(5):
        hdr, motion = slow(*bars(40, 24, index))
        packet = cam.step(hdr, motion, t_ns=FRAME_NS * index, stream=side.cuda_stream)
        packets.append(on_host(packet))
    assert_same(tuple(np.concatenate([p[i] for p in packets]) for i in range(4)), expected)

    class Interface:
        """Version 3, with the stream that the array is written in."""

        def __init__(self, tensor):
            self.tensor = tensor
            inner = tensor.__cuda_array_interface__
            self.__cuda_array_interface__ = {**inner, "version": 3, "stream": side.cuda_stream}

    assert_same(events(camera(), lambda h, m: tuple(map(Interface, slow(h, m)))), expected)


def test_tensors_are_taken_over_where_they_lie_and_outlive_the_step():
    host, device = camera(), camera(packets="cuda")
    kept = []
    for index in range(6):
        hdr, motion = bars(40, 24, index)
        expected = host.step(hdr, motion, t_ns=FRAME_NS * index)
        packet = device.step(cuda(hdr), cuda(motion), t_ns=FRAME_NS * index)
        assert len(packet) == len(expected) and packet.base_ns == expected.base_ns
        t_ns = torch.from_dlpack(packet.t_ns)
        assert t_ns.is_cuda and t_ns.dtype == torch.int64 and t_ns.data_ptr() == _pointer(packet.t_ns)
        x = torch.as_tensor(packet.x, device="cuda")
        assert x.dtype == torch.int16 and torch.from_dlpack(packet.p).dtype == torch.uint8
        kept.append((t_ns, x, expected))
        del packet
        gc.collect()
    device.close()
    for t_ns, x, expected in kept:
        np.testing.assert_array_equal(t_ns.cpu().numpy(), expected.t_ns)
        np.testing.assert_array_equal(x.cpu().numpy(), expected.x)


def test_tensors_do_not_pass_for_empty_where_their_elements_are_asked_for():
    cam = camera(packets="cuda")
    for index in range(2):
        packet = cam.step(*map(cuda, bars(40, 24, index)), t_ns=FRAME_NS * index)
    assert len(packet) > 100 and len(packet.x) == len(packet)
    for ask in (list, tuple, iter, np.asarray, np.array, lambda x: x[0], lambda x: x[-1], lambda x: 0 in x):
        for column in (packet.x, packet.t_ns, packet.p):
            with pytest.raises(TypeError, match=r"\.numpy\(\), or view it there with torch\.from_dlpack"):
                ask(column)
    with pytest.raises(TypeError, match=r"shape \[2, 24, 40\]"):
        np.asarray(cam.event_frame())
    frame = cam.event_frame()
    for own, whole in zip(frame, frame.numpy(), strict=True):
        np.testing.assert_array_equal(own.numpy(), whole)
        np.testing.assert_array_equal(own[3:5].numpy(), whole[3:5])
    with pytest.raises(IndexError, match="index 2 into .* expected below 2"):
        frame[2]
    with pytest.raises(IndexError, match="step 2"):
        packet.x[::2]


def _pointer(tensor):
    return tensor.__cuda_array_interface__["data"][0]


def test_forms_are_those_of_the_host():
    host, device = camera(), camera(packets="cuda")
    for index in range(3):
        hdr, motion = bars(40, 24, index)
        host.step(hdr, motion, t_ns=FRAME_NS * index)
        device.step(cuda(hdr), cuda(motion), t_ns=FRAME_NS * index)
        frame, grid = (torch.from_dlpack(form) for form in (device.event_frame(), device.voxel_grid(5)))
        assert frame.shape == (2, 24, 40) and grid.dtype == torch.float32
        np.testing.assert_array_equal(frame.cpu().numpy(), host.event_frame())
        np.testing.assert_array_equal(grid.cpu().numpy(), host.voxel_grid(5))


@pytest.mark.parametrize("count", [5, 300])
def test_tiled_environments_on_the_device_are_those_of_the_host(count):
    sensor = esaac.SensorModel("dvs128", width=24, height=16, contrast_on=0.15, contrast_off=0.15)
    host = esaac.TiledEventCamera(sensor, count, device="cuda:0")
    device = esaac.TiledEventCamera(sensor, count, device="cuda:0", packets="cuda")
    for index in range(3):
        pairs = [bars(24, 16, index + 0.3 * env) for env in range(count)]
        hdr, motion = (np.stack(images) for images in zip(*pairs))
        if index == 2:
            host.reset([1]), device.reset(torch.tensor([1], device="cuda"))
        expected = host.step(hdr, motion, t_ns=FRAME_NS * index)
        t_ns = torch.full((count,), FRAME_NS * index, device="cuda")
        packet = device.step(cuda(hdr), cuda(motion), t_ns=t_ns)
        np.testing.assert_array_equal(packet.offsets, expected.offsets)
        np.testing.assert_array_equal(torch.from_dlpack(packet.t_ns).cpu().numpy(), expected.t_ns)
        for env in (0, 1, count - 1):
            for actual, wanted in zip(on_host(packet[env]), on_host(expected[env])):
                np.testing.assert_array_equal(actual, wanted)
        np.testing.assert_array_equal(device.voxel_grids(3).numpy(), host.voxel_grids(3))
    assert device.statistics["host_copies"] == 0 and len(packet) > 500


def test_images_of_environments_that_wait_are_not_copied():
    # An image is larger than the gap that is copied along.
    count, size = 5, {"width": 640, "height": 480}
    sensor = esaac.SensorModel("dvs128", **size, contrast_on=0.15, contrast_off=0.15)
    host = esaac.TiledEventCamera(sensor, count, device="cuda:0")
    device = esaac.TiledEventCamera(sensor, count, device="cuda:0", packets="cuda")
    for index, waiting in enumerate(([], [1, 2], [0, 4])):
        pairs = [bars(640, 480, index + 0.3 * env) for env in range(count)]
        hdr, motion = (np.stack(images) for images in zip(*pairs))
        hdr[waiting] = np.nan
        times = [None if env in waiting else FRAME_NS * index for env in range(count)]
        expected = host.step(hdr, motion, t_ns=times)
        before = device.statistics["device_copies"] if index else 0
        packet = device.step(cuda(hdr), cuda(motion), t_ns=times)
        # Runs of environments, of two arrays.
        assert device.statistics["device_copies"] - before == 2 * (1, 2, 1)[index]
        np.testing.assert_array_equal(packet.offsets, expected.offsets)
        np.testing.assert_array_equal(torch.from_dlpack(packet.t_ns).cpu().numpy(), expected.t_ns)
        for name in ("base_ns", "watermark_ns", "sequence", "dropped"):
            assert [getattr(p, name) for p in packet] == [getattr(p, name) for p in expected]
    assert len(packet) > 500


def test_cupy_and_jax_take_and_give():
    import cupy
    import jax

    expected = run(camera(), count=5)
    cam = camera(packets="cuda")
    assert_same(events(cam, lambda hdr, motion: (cupy.asarray(hdr), cupy.asarray(motion))), expected)
    packet = cam.step(*(cupy.asarray(a) for a in bars(40, 24, 5)), t_ns=FRAME_NS * 5)
    assert int(cupy.asarray(packet.x).sum()) == int(packet.x.numpy().astype(np.int64).sum())
    device = jax.devices("gpu")[0]
    assert_same(
        events(camera(), lambda h, m: (jax.device_put(h, device), jax.device_put(m, device))), expected
    )
    assert jax.dlpack.from_dlpack(packet.x).shape == (len(packet),)


def test_warp_takes_and_gives():
    """As Isaac Sim hands frames out: Warp arrays, some over memory that is another's."""
    import warp as wp

    wp.config.quiet = True
    expected = run(camera(), count=5)
    cam = camera(packets="cuda")
    four = lambda motion: np.concatenate([motion, np.zeros_like(motion)], axis=2)
    warp = lambda hdr, motion: (wp.array(hdr, device="cuda:0"), wp.array(four(motion), device="cuda:0"))
    assert_same(events(cam, warp), expected)
    assert cam.statistics["host_copies"] == 0
    packet = cam.step(*warp(*bars(40, 24, 5)), t_ns=FRAME_NS * 5)
    x = wp.from_dlpack(packet.x)
    assert x.dtype == wp.int16 and x.ptr == _pointer(packet.x)
    np.testing.assert_array_equal(x.numpy(), packet.x.numpy())


def test_the_stream_that_warp_works_in_is_waited_for():
    import warp as wp

    wp.config.quiet = True
    wp.init()
    expected = run(camera(), count=5)
    side = torch.cuda.Stream()
    change = lambda hdr, motion: tuple(map(wp.from_torch, late(side, hdr, motion)))
    with wp.ScopedStream(wp.stream_from_torch(side)):
        assert_same(events(camera(), change), expected)


def test_nothing_is_left_behind_over_ten_thousand_steps():
    cam = esaac.EventCamera(
        "dvs128", width=32, height=32, contrast_on=0.1, contrast_off=0.1, device="cuda:0", packets="cuda"
    )
    frames = [tuple(map(cuda, bars(32, 32, index))) for index in range(16)]

    def steps(first, count):
        for index in range(first, first + count):
            packet = cam.step(*frames[index % 16], t_ns=FRAME_NS * index)
            torch.from_dlpack(packet.t_ns)

    steps(0, 1000)
    gc.collect()
    torch.cuda.synchronize()
    before = torch.cuda.mem_get_info()[0]
    steps(1000, 10_000)
    gc.collect()
    assert before - torch.cuda.mem_get_info()[0] < 16 << 20


def test_a_closed_camera_and_a_wrong_device_are_told():
    cam = camera(packets="cuda")
    cam.step(*map(cuda, bars(40, 24, 0)), t_ns=0)
    cam.close()
    with pytest.raises(esaac.ClosedError):
        cam.step(*map(cuda, bars(40, 24, 1)), t_ns=FRAME_NS)
    software = [entry for entry in esaac.devices() if entry["suitable"] and entry["cuda"] is None]
    for entry in software:
        other = esaac.EventCamera("dvs128", **SIZE, device=entry["index"])
        with pytest.raises(esaac.DeviceError, match="same UUID"):
            other.step(*map(cuda, bars(40, 24, 0)), t_ns=0)
    with pytest.raises(esaac.DeviceError, match="no CUDA device 64"):
        camera(device="cuda:64")


@pytest.mark.parametrize(("own", "other"), [(0, 1), (1, 0)])
def test_arrays_on_another_gpu_are_told_both_names(own, other):
    if torch.cuda.device_count() == 1:
        # Nothing can lie on another one, and no camera can be made there.
        with pytest.raises(esaac.DeviceError, match="no CUDA device 1"):
            camera(device="cuda:1")
        return
    there = lambda array, device: cuda(array).to(f"cuda:{device}")
    cam = camera(device=f"cuda:{own}")
    message = f"hdr lies on cuda:{other}, expected cuda:{own}, the engine's device .*; make the camera with"
    for change in (lambda tensor: tensor, _Plain):
        with pytest.raises(esaac.FrameError, match=message):
            cam.step(*(change(there(array, other)) for array in bars(40, 24, 0)), t_ns=0)
    hdr, motion = bars(40, 24, 0)
    with pytest.raises(esaac.FrameError, match=f"motion lies on cuda:{other}, expected cuda:{own}"):
        cam.step(there(hdr, own), there(motion, other), t_ns=0)
    # The camera goes on, and each GPU gives the same bits.
    actual = events(cam, lambda hdr, motion: (there(hdr, own), there(motion, own)), count=3)
    assert_same(actual, run(camera(), count=3))


class _Plain:
    """An array that knows its address and no DLPack."""

    def __init__(self, tensor):
        self._tensor = tensor
        self.__cuda_array_interface__ = tensor.__cuda_array_interface__


def rigid_frames(place, record, given):
    """Events of a camera whose depth, ids and poses come by `place`, through a recorder or at once."""
    import rigid_scene as of

    cam, packets, taken = of.camera(device="cuda:0", packets="cuda"), [], 0
    recorder = esaac.PoseRecorder(ids={1: 0})
    for index, (hdr, depth, ids) in enumerate(of.IMAGES):
        while record and taken < len(of.TIMES_NS) and of.TIMES_NS[taken] <= (index + 1) * FRAME_NS:
            camera_pose, bodies = place(of.CAMERA[taken]), place(of.BODIES[taken])
            recorder.record(int(of.TIMES_NS[taken]), camera_pose, bodies)
            taken += 1
        poses = recorder if record else esaac.Poses(of.TIMES_NS, place(of.CAMERA), place(of.BODIES))
        depth, ids = given(depth), given(ids.astype(np.int32))
        packets.append(
            on_host(cam.step(given(hdr), t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=poses))
        )
    assert cam.statistics["host_copies"] == 0 and cam.statistics["device_copies"] == 3 * len(of.IMAGES)
    return tuple(np.concatenate([packet[i] for packet in packets]) for i in range(4))


@pytest.mark.parametrize("record", [False, True])
def test_depth_ids_and_poses_of_every_library_give_the_same_bits(record):
    import cupy
    import rigid_scene as of
    import warp as wp

    expected = of.run(of.camera(device="cuda:0"))
    for place in (np.asarray, cuda, cupy.asarray, lambda array: wp.array(array, device="cuda:0")):
        for given in (cuda, cupy.asarray, lambda array: wp.array(array, device="cuda:0")):
            assert_same(rigid_frames(place, record, given), expected)


@pytest.mark.parametrize("count", [1, 3, 300])
def test_labels_lie_on_the_device_and_are_those_that_the_host_would_have(count):
    import rigid_scene as of

    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **of.SENSOR)
    poses = esaac.Poses(of.TIMES_NS, np.stack([of.CAMERA] * count, axis=1), of.BODIES)
    alone = of.camera(device="cuda:0")
    options = {"intrinsics": of.LENS, "device": "cuda:0", "packets": "cuda"}
    with esaac.TiledEventCamera(sensor, count, **options) as envs:
        for index, (hdr, depth, ids) in enumerate(of.IMAGES):
            t_ns = index * FRAME_NS
            alone.step(
                hdr, t_ns=t_ns, depth=depth, ids=ids, poses=esaac.Poses(of.TIMES_NS, of.CAMERA, of.BODIES)
            )
            hdr, depth, ids = (
                cuda(np.stack([image] * count)) for image in (hdr, depth, ids.astype(np.int32))
            )
            packet = envs.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=poses)
            labels = torch.from_dlpack(envs.event_ids())
            assert labels.is_cuda and labels.dtype == torch.int64 and len(labels) == len(packet)
            expected = np.tile(alone.event_ids(), count)
            np.testing.assert_array_equal(labels.cpu().numpy(), expected)
    assert len(expected) > 100 * count and set(expected) == {0, 1}


def test_depth_on_the_host_beside_colour_on_the_device_is_told():
    import rigid_scene as of

    hdr, depth, ids = of.IMAGES[0]
    poses = esaac.Poses(of.TIMES_NS, of.CAMERA, of.BODIES)
    with pytest.raises(esaac.FrameError, match="hdr lies on a CUDA device and depth on the host"):
        of.camera(device="cuda:0").step(
            cuda(hdr), t_ns=0, depth=depth, ids=cuda(ids.astype(np.int32)), poses=poses
        )


MAPPED_IN_PARTS = """
import esaac, torch

camera = esaac.EventCamera("hd", device="cuda:0", width=1400, height=1400)
for index in range(3):
    hdr = torch.full((1400, 1400, 4), 0.2 + 0.3 * index, device="cuda")
    packet = camera.step(hdr, torch.zeros((1400, 1400, 2), device="cuda"), t_ns=33_333_333 * index)
assert len(packet) > 1400 * 1400, len(packet)
"""


def test_arrays_whose_memory_is_mapped_in_parts_are_taken():
    # Torch maps 20 MB after 20 MB, one behind the other; the colours are of 31 MB.
    environment = {**os.environ, "PYTORCH_CUDA_ALLOC_CONF": "expandable_segments:True"}
    run_apart = [sys.executable, "-c", MAPPED_IN_PARTS]
    done = subprocess.run(
        run_apart, env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
