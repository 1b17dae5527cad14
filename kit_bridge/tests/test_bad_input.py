"""Bad input is a clear exception, and the camera goes on after it."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join, run

import esaac


def camera(**parameters):
    parameters = {"synthesis": "motion", "contrast_on": 0.15, "contrast_off": 0.15, **parameters}
    return esaac.EventCamera("dvs128", width=40, height=24, **parameters)


HDR, MOTION = bars(40, 24, 0)


@pytest.mark.parametrize(
    ("hdr", "motion", "message"),
    [
        (HDR.astype(np.float64), MOTION, "hdr has dtype <f8, expected float16, float32 or uint8"),
        (HDR.astype(">f4"), MOTION, "hdr has dtype >f4"),
        (HDR.astype(object), MOTION, "dtype"),
        (HDR.tolist(), MOTION, "hdr has dtype <f8"),
        (None, MOTION, "hdr has dtype"),
        (HDR, MOTION.astype(np.uint8), r"motion has dtype \|u1, expected float16 or float32"),
        (HDR, MOTION.astype(np.int32), "motion has dtype <i4, expected float16 or float32"),
        (HDR[:-1], MOTION, r"hdr has shape \[23, 40, 4\], expected \(24, 40, 1 or 3 or 4\)"),
        (HDR[..., :2], MOTION, r"hdr has shape \[24, 40, 2\]"),
        (HDR[None], MOTION, "hdr has shape"),
        (HDR, MOTION[..., :1], r"motion has shape \[24, 40, 1\], expected \(24, 40, 2 or 3 or 4\)"),
        (HDR, MOTION[:, :5], "motion has shape"),
        (HDR[0, 0, 0], MOTION, r"hdr has shape \[\], expected"),
    ],
)
def test_a_wrong_array_is_named(hdr, motion, message):
    cam = camera()
    with pytest.raises(esaac.FrameError, match=message):
        cam.step(hdr, motion, t_ns=0)
    # Nothing was seen: the camera is as new.
    assert_same(run(cam), run(camera()))


def test_a_synthesis_that_needs_motion_says_so():
    cam = camera(synthesis="motion")
    with pytest.raises(esaac.FrameError, match="needs motion vectors"):
        cam.step(HDR, t_ns=0)
    assert_same(run(cam), run(camera()))


def test_later_frames_are_as_the_first():
    cam = camera()
    cam.step(HDR, MOTION, t_ns=0)
    with pytest.raises(esaac.FrameError, match="f16 colour.*expected f32 colour"):
        cam.step(HDR.astype(np.float16), MOTION, t_ns=FRAME_NS)
    with pytest.raises(esaac.FrameError, match="without motion.*expected"):
        cam.step(HDR, t_ns=FRAME_NS)
    assert len(cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)) > 100


def test_poses_of_another_kind():
    cam, poses = camera(intrinsics=(40.0, 40.0, 19.5, 11.5)), np.zeros((2, 7))
    depth = np.ones((24, 40), np.float32)
    with pytest.raises(esaac.ArgumentError, match=r"poses are a ndarray, expected esaac\.Poses or"):
        cam.step(HDR, t_ns=0, depth=depth, poses=poses)
    rig = esaac.Rig([cam.sensor], intrinsics=[(40.0, 40.0, 19.5, 11.5)])
    with pytest.raises(esaac.ArgumentError, match=r"poses are a ndarray, expected esaac\.Poses or"):
        rig.step([(HDR, None, depth)], t_ns=0, poses=[poses])
    for alone in (esaac.Poses([0], poses[:1]), esaac.PoseRecorder(), 3):
        kind = type(alone).__name__
        with pytest.raises(
            esaac.ArgumentError, match=rf"poses are a {kind}, expected a list with esaac\.Poses"
        ):
            rig.step([(HDR, None, depth)], t_ns=0, poses=alone)


def test_a_lens_has_four_numbers():
    for given in ((40.0, 40.0, 19.5), (40.0, 40.0, 19.5, 11.5, 0.0), (40.0, 40.0, 19.5, 11.5, 0.1, 0.2)):
        with pytest.raises(esaac.ArgumentError, match=r"intrinsics are \(40.*expected .*\(fx, fy, cx, cy\)"):
            camera(intrinsics=given)


def test_a_frame_of_a_rig_has_no_more_than_its_images():
    rig = esaac.Rig([camera().sensor] * 2)
    for frame in ((HDR, None, None, None, None), ()):
        expected = f"frame of camera 1 has {len(frame)} entries, expected 1 to 4: hdr, motion, depth, ids"
        for step in (rig.step, rig.submit):
            with pytest.raises(esaac.FrameError, match=expected):
                step([(HDR, MOTION), frame], t_ns=0)
    assert [len(packet) for packet in rig.step([(HDR, MOTION), (HDR, MOTION, None, None)], t_ns=0)] == [0, 0]


def test_lenses_of_a_rig_are_a_list():
    sensor, lens = camera().sensor, (40.0, 40.0, 19.5, 11.5)
    expected = r"expected a list with Intrinsics, \(fx, fy, cx, cy\) or None for each camera"
    for given, told in (
        (esaac.Intrinsics(*lens), "are a Intrinsics"),
        (40.0, "are a float"),
        (lens, r"are \[40.0, 40.0, 19.5, 11.5\]"),
    ):
        with pytest.raises(esaac.ArgumentError, match=f"intrinsics {told}, {expected}"):
            esaac.Rig([sensor] * 4, intrinsics=given)


@pytest.mark.parametrize("count", [2.0, "3", None, 0, 65537])
def test_the_number_of_environments_is_a_whole_one(count):
    with pytest.raises(
        esaac.ArgumentError, match=f"num_envs is {count!r}, expected a whole number from 1 to 65536"
    ):
        esaac.TiledEventCamera("dvs128", count)


def test_attributes_that_nothing_reads_are_refused():
    cam, sensor = camera(), camera().sensor
    rig, tiled = esaac.Rig([sensor]), esaac.TiledEventCamera(sensor, 2)
    for made, how in (
        (cam, "camera.sensor = camera.sensor.replace"),
        (rig, r"rig.set_sensor\(camera, rig.sensors\[camera\].replace"),
        (tiled, r"cameras.set_sensor\(env, cameras.sensors\[env\].replace"),
    ):
        with pytest.raises(
            AttributeError, match=rf"`contrast_off` is a parameter .* expected `{how}\(contrast_off="
        ):
            made.contrast_off = 0.4
        kind = type(made).__name__
        with pytest.raises(AttributeError, match=rf"{kind} has no attribute `sensr`; .*{how}\(contrast_on="):
            made.sensr = sensor
    cam.sensor = sensor.replace(contrast_on=0.4)
    assert cam.sensor.contrast_on == 0.4
    for made in (
        esaac.PoseRecorder(),
        esaac.Poses([0], np.array([[0, 0, 0, 0, 0, 0, 1]])),
    ):
        with pytest.raises(AttributeError, match="has no attribute 'id'"):
            made.id = {1: 0}


def test_a_class_that_inherits_has_attributes_of_its_own():
    class Named(esaac.EventCamera):
        contrast_off = None

        def __init__(self, label):
            super().__init__("dvs128", width=40, height=24)
            self.label, self.contrast_off = label, 0.3

    cam = Named("left")
    assert (cam.label, cam.contrast_off) == ("left", 0.3)
    with pytest.raises(AttributeError, match="`contrast_on` is a parameter of the sensor"):
        cam.contrast_on = 0.4


def test_time_goes_forwards_and_not_too_far():
    cam = camera()
    cam.step(HDR, MOTION, t_ns=FRAME_NS)
    for t_ns in (FRAME_NS, 0, -5):
        with pytest.raises(esaac.FrameError, match=f"frame time {t_ns} ns is not after"):
            cam.step(HDR, MOTION, t_ns=t_ns)
    with pytest.raises(esaac.FrameError, match="gap of"):
        cam.step(HDR, MOTION, t_ns=5_000_000_000)
    for t_ns in (1 << 63, -(1 << 70)):
        with pytest.raises(esaac.ArgumentError, match=f"t_ns is {t_ns}, expected -9223372036854775808 to"):
            cam.step(HDR, MOTION, t_ns=t_ns)
    with pytest.raises(TypeError, match=r"t_ns is 0\.5, expected an integer, nanoseconds"):
        cam.step(HDR, MOTION, t_ns=0.5)
    rig = esaac.Rig([cam.sensor])
    for t_ns in (0.5, [0.5]):
        with pytest.raises(TypeError, match=r"t_ns is 0\.5, expected an integer, nanoseconds"):
            rig.step([(HDR, MOTION)], t_ns=t_ns)
    cam.reset()
    assert len(cam.step(HDR, MOTION, t_ns=0)) == 0


def test_a_closed_camera_says_so_and_its_packets_stay():
    with camera() as cam:
        cam.step(HDR, MOTION, t_ns=0)
        packet = cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)
        assert not cam.closed
    assert cam.closed
    cam.close()
    for call in (
        lambda: cam.step(HDR, MOTION, t_ns=2 * FRAME_NS),
        cam.event_frame,
        cam.reset,
        cam.memory,
        cam.save,
        lambda: cam.sensor,
        lambda: cam.statistics,
    ):
        with pytest.raises(esaac.ClosedError, match="closed"):
            call()
    gc.collect()
    assert packet.x.sum() > 0 and packet.t_ns[-1] <= FRAME_NS


def test_arrays_freed_by_their_owner_are_kept_for_the_step():
    def only_reference(hdr, motion):
        return hdr.copy(), motion.copy()

    expected = run(camera())
    cam, packets = camera(), []
    for index in range(4):
        hdr, motion = only_reference(*bars(40, 24, index))
        packets.append(cam.step(hdr, motion, t_ns=FRAME_NS * index))
        del hdr, motion
        gc.collect()
    np.testing.assert_array_equal(np.concatenate([p.x for p in packets]), expected[0])


def test_devices_are_listed_and_wrong_ones_refused():
    listed = esaac.devices()
    assert any(entry["suitable"] for entry in listed)
    best = camera().device
    assert best["uuid"] in {entry["uuid"] for entry in listed}
    with camera(device=best["uuid"]) as cam:
        assert cam.device == best
    with pytest.raises(esaac.DeviceError, match="no Vulkan device 99"):
        camera(device=99)
    with pytest.raises(esaac.ArgumentError, match="expected a device's number or its UUID"):
        camera(device="best")
    for device in ("cuda:x", "cuda1", "cuda-1", "cuda:"):
        with pytest.raises(esaac.ArgumentError, match="cuda:N"):
            camera(device=device)
    with pytest.raises(esaac.ArgumentError, match="`host`, `mapped` or `cuda`"):
        camera(packets="gpu")


def test_a_device_is_opened_once_by_whatever_name(tmp_path):
    """A device has threads of its driver, or files."""
    count = """
import os, sys, esaac
names = eval(sys.argv[1])
cameras = [esaac.EventCamera("dvs128", width=8, height=8, device=name) for name in names]
print(len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")))
"""
    best = camera().device
    index = next(entry["index"] for entry in esaac.devices() if entry["uuid"] == best["uuid"])
    counted = [
        subprocess.run(
            [sys.executable, "-c", count, repr(names)], capture_output=True, text=True, check=True
        ).stdout
        for names in ([best["uuid"]] * 3, [best["uuid"], index, None])
    ]
    assert counted[0] == counted[1]


def test_two_cameras_in_two_threads_give_what_each_gives_alone():
    expected = run(camera(seed=1), count=8), run(camera(seed=2), count=8)
    cameras, results = (camera(seed=1), camera(seed=2)), [None, None]

    def work(number):
        results[number] = run(cameras[number], count=8)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for actual, wanted in zip(results, expected):
        assert_same(actual, wanted)


def test_threads_on_one_camera_wait_for_each_other():
    cam, faults, done = camera(), [], []
    clock = iter(range(1000))
    lock = threading.Lock()

    def work():
        for _ in range(10):
            with lock:
                t_ns = FRAME_NS * next(clock)
            try:
                done.append(len(cam.step(HDR, MOTION, t_ns=t_ns)))
            except esaac.FrameError as error:
                # Another thread was faster.
                faults.append(str(error))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(done) + len(faults) == 40 and all("is not after" in fault for fault in faults)


def test_the_interpreter_is_free_while_the_device_works():
    cam = esaac.EventCamera("vga")
    hdr, motion = bars(640, 480, 0)
    cam.step(hdr, motion, t_ns=0)
    ticks, going = [0], threading.Event()

    def count():
        while not going.is_set():
            ticks[0] += 1
            going.wait(0.0005)

    thread = threading.Thread(target=count)
    thread.start()
    before = ticks[0]
    cam.step(*bars(640, 480, 1), t_ns=FRAME_NS)
    during = ticks[0] - before
    going.set()
    thread.join()
    assert during >= 2


def interrupted(camera, step, count, usual_s):
    """Packets of `count` steps, each of which a real signal may interrupt, and how many were. A step usually takes
    `usual_s`."""
    packets, interrupts = [], 0
    for index in range(count):
        # Early ones come before the device works, late ones after the step.
        signal.setitimer(signal.ITIMER_REAL, usual_s * (0.05 + 0.15 * (index % 8)))
        while True:
            try:
                packet = step(index)
                signal.setitimer(signal.ITIMER_REAL, 0)
                break
            except KeyboardInterrupt:
                interrupts += 1
                packet = camera.last_packet
                if packet is not None and packet.watermark_ns == FRAME_NS * index:
                    break
        packets.append(packet)
    return packets, interrupts


@pytest.fixture
def alarm_is_an_interrupt():
    def interrupt(*_):
        raise KeyboardInterrupt

    old = signal.signal(signal.SIGALRM, interrupt)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, old)


def test_an_interrupt_loses_no_packet(alarm_is_an_interrupt):
    def big():
        return esaac.EventCamera("dvs128", width=320, height=240, contrast_on=0.15, contrast_off=0.15)

    frames = [bars(320, 240, index) for index in range(16)]
    alone = big()
    expected, took_s = [], []
    for index, frame in enumerate(frames):
        started = time.perf_counter()
        expected.append(alone.step(*frame, t_ns=FRAME_NS * index))
        took_s.append(time.perf_counter() - started)
    cam = big()
    packets, interrupts = interrupted(
        cam,
        lambda index: cam.step(*frames[index], t_ns=FRAME_NS * index),
        len(frames),
        float(np.median(took_s)),
    )
    assert interrupts >= 4
    assert_same(join(packets), join(expected))
    assert [packet.sequence for packet in packets] == list(range(len(frames)))


def test_the_last_packet_is_what_the_last_step_returned_and_outlives_the_camera():
    cam = camera()
    assert cam.last_packet is None
    for index in range(2):
        packet = cam.step(*bars(40, 24, index), t_ns=FRAME_NS * index)
        assert cam.last_packet is packet
    with pytest.raises(esaac.FrameError):
        cam.step(*bars(40, 24, 2), t_ns=0)
    cam.close()
    assert cam.last_packet is packet and len(packet) > 100
    sensor = esaac.SensorModel("dvs128", width=40, height=24)
    rig, tiled = esaac.Rig([sensor, sensor]), esaac.TiledEventCamera(sensor, 2)
    assert rig.last_packets == [] and tiled.last_packet is None
    hdr, motion = np.stack([HDR] * 2), np.stack([MOTION] * 2)
    packets, packet = rig.step([(HDR, MOTION)] * 2, 0), tiled.step(hdr, motion, t_ns=0)
    assert rig.last_packets == packets and tiled.last_packet is packet


def test_a_forked_child_is_told_and_harms_nothing():
    cam = camera()
    cam.step(HDR, MOTION, t_ns=0)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)
            verdict = "no error"
        except esaac.ForkError as error:
            verdict = "fork error" if "after the fork" in str(error) else str(error)
        except BaseException as error:
            verdict = repr(error)
        os.write(write, verdict.encode())
        del cam
        gc.collect()
        os._exit(0)
    os.close(write)
    _, status = os.waitpid(child, 0)
    assert os.read(read, 1000).decode() == "fork error" and status == 0
    assert len(cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)) > 100


def test_memory_stays_where_it_is_over_ten_thousand_steps():
    cam = esaac.EventCamera("dvs128", width=8, height=8, contrast_on=0.1, contrast_off=0.1)
    frames = [bars(8, 8, index) for index in range(16)]
    page = os.sysconf("SC_PAGE_SIZE")

    def resident():
        gc.collect()
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * page

    def steps(first, count):
        for index in range(first, first + count):
            packet = cam.step(*frames[index % 16], t_ns=FRAME_NS * index)
            _ = packet.t_ns, packet.x
            if index % 100 == 0:
                cam.event_frame()

    steps(0, 1000)
    before, uses = resident(), cam.memory()
    steps(1000, 10_000)
    assert resident() - before < 4 << 20
    assert cam.memory() == uses
