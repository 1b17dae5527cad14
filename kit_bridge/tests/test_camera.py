"""One camera on arrays of the host."""

import pickle

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join, run

import esaac

SIZE = {"width": 40, "height": 24}


def camera(**parameters):
    return esaac.EventCamera("dvs128", contrast_on=0.15, contrast_off=0.15, **{**SIZE, **parameters})


def test_packets_are_ordered_and_complete_and_own_their_memory():
    with camera() as cam:
        assert len(cam.step(*bars(40, 24, 0), t_ns=0)) == 0
        packet = cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)
        again = cam.step(*bars(40, 24, 2), t_ns=2 * FRAME_NS)
    assert len(packet) > 500 and len(again) > 500
    assert packet.x.dtype == np.uint16 and packet.p.dtype == np.uint8 and packet.t_ns.dtype == np.int64
    assert (np.diff(packet.t_ns) >= 0).all()
    assert 0 < packet.t_ns[0] and packet.t_ns[-1] <= packet.watermark_ns == FRAME_NS
    assert (packet.x < 40).all() and (packet.y < 24).all() and set(packet.p) == {0, 1}
    assert again.t_ns[0] > packet.watermark_ns and again.sequence == packet.sequence + 1
    # Views of the engine's vectors: no copy, and no other's to change.
    assert not packet.x.flags.owndata and packet.x.base is not None
    assert packet.t_ns is packet.t_ns
    np.testing.assert_array_equal(packet.t_ns, packet.base_ns + packet.t_offset_ns.astype(np.int64))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_channels_and_strides_make_no_difference_on_the_host(dtype):
    expected = run(camera(), change=lambda hdr, motion: (hdr.astype(dtype), motion))
    changes = {
        "three channels": lambda hdr, motion: (np.ascontiguousarray(hdr[..., :3]), motion),
        "a view of three": lambda hdr, motion: (hdr[..., :3], motion),
        "one channel": lambda hdr, motion: (hdr[..., :1], motion),
        "no channel axis": lambda hdr, motion: (hdr[..., 0], motion),
        "columns first": lambda hdr, motion: (np.asfortranarray(hdr), np.asfortranarray(motion)),
        "negative strides": lambda hdr, motion: (hdr[::-1].copy()[::-1], motion[:, ::-1].copy()[:, ::-1]),
        "read-only": lambda hdr, motion: (_read_only(hdr), _read_only(motion)),
        "every second row": lambda hdr, motion: (np.repeat(hdr, 2, axis=0)[::2], motion),
        "four of motion": lambda hdr, motion: (hdr, np.concatenate([motion, motion * 9], axis=2)[..., :3]),
    }
    for what, change in changes.items():
        actual = run(camera(), change=lambda hdr, motion, change=change: change(hdr.astype(dtype), motion))
        assert len(actual[0]) == len(expected[0]), what
        assert_same(actual, expected)


def _read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


def test_arrays_of_other_protocols_are_read_where_they_lie():
    class Interface:
        def __init__(self, array):
            self.array = array
            self.__array_interface__ = array.__array_interface__

    expected = run(camera())
    assert_same(run(camera(), change=lambda hdr, motion: (memoryview(hdr), memoryview(motion))), expected)
    assert_same(run(camera(), change=lambda hdr, motion: (Interface(hdr), Interface(motion))), expected)


def test_warp_arrays_are_read_where_they_lie():
    import warp as wp

    wp.config.quiet = True
    expected = run(camera())
    actual = run(
        camera(),
        change=lambda hdr, motion: (
            wp.array(hdr, device="cpu"),
            wp.array(motion, dtype=wp.vec2, device="cpu"),
        ),
    )
    assert_same(actual, expected)


def test_srgb_bytes_are_decoded():
    def encode(hdr, motion):
        return (np.clip(hdr, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8), motion

    x, _, _, _ = run(camera(), change=encode)
    assert len(x) > 500


def test_event_frames_and_voxel_grids_count_the_last_packet():
    cam = camera()
    with pytest.raises(esaac.ArgumentError, match="no frame"):
        cam.event_frame()
    for index in range(3):
        packet = cam.step(*bars(40, 24, index), t_ns=FRAME_NS * index)
    frame = cam.event_frame()
    expected = np.zeros((2, 24, 40), np.int32)
    np.add.at(expected, (packet.p, packet.y, packet.x), 1)
    np.testing.assert_array_equal(frame, expected)
    grid = cam.voxel_grid(bins=5)
    assert grid.shape == (5, 24, 40) and grid.dtype == np.float32
    place = (packet.t_ns - FRAME_NS) / FRAME_NS * 4
    sign = packet.p.astype(float) * 2 - 1
    expected = np.zeros((5, 24, 40))
    for b in range(5):
        np.add.at(expected[b], (packet.y, packet.x), sign * np.maximum(0, 1 - abs(place - b)))
    np.testing.assert_allclose(grid, expected, atol=1e-3)
    np.testing.assert_array_equal(cam.voxel_grid(1)[0], expected.sum(0).round().astype(np.float32))
    rig = esaac.Rig(["dvs128"])
    with esaac.TiledEventCamera("dvs128", 2, width=40, height=24) as envs:
        for grid in (cam.voxel_grid, rig.voxel_grids, envs.voxel_grids):
            for bins in (0, -1, 257, 2.5, None):
                expected = f"bins is {bins}, expected a whole number from 1 to 256"
                with pytest.raises(esaac.ArgumentError, match=expected):
                    grid(bins)


def test_a_saved_run_goes_on_as_one():
    expected = run(camera(profile="noisy"), count=6)
    first = camera(profile="noisy")
    head = [first.step(*bars(40, 24, i), t_ns=FRAME_NS * i) for i in range(3)]
    second = camera(profile="noisy")
    second.restore(first.save())
    tail = [second.step(*bars(40, 24, i), t_ns=FRAME_NS * i) for i in range(3, 6)]
    assert_same(join(head + tail), expected)
    with pytest.raises(
        esaac.ArgumentError,
        match="camera 0 .* `contrast_mismatch = 0.0`, expected `contrast_mismatch = 0.05`",
    ):
        camera().restore(first.save())


def test_a_state_that_is_damaged_is_refused():
    cam = camera()
    steps = lambda indices: join([cam.step(*bars(40, 24, i), t_ns=FRAME_NS * i) for i in indices])
    steps(range(2))
    state = cam.save()
    expected = steps(range(2, 5))
    for wrong, message in (
        (b"nonsense", "no saved state"),
        (b"", "no saved state"),
        (bytes(100), "no saved state"),
        (state[:10], "no saved state"),
        ("state", "saved state is a str, expected bytes"),
        (None, "saved state is a NoneType, expected bytes"),
        (b"ESAACPY2" + state[8:], "saved state of format b'ESAACPY2', expected b'ESAACPY5'"),
        (state[:60], "saved state is damaged: its header's CRC-32 is .*, expected"),
        (state[:-1], "saved state has .* bytes of rigs, expected"),
        (state + b"junk", "saved state has .* bytes of rigs, expected"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            cam.restore(wrong)
    # The last two are of the rig.
    for index in (8, 18, 30, 60, len(state) // 2, len(state) - 1):
        flipped = bytearray(state)
        flipped[index] ^= 1
        with pytest.raises(esaac.ArgumentError, match="damaged: its .*CRC-32 is .*, expected"):
            cam.restore(bytes(flipped))
    cam.restore(memoryview(bytearray(state)))
    assert_same(steps(range(2, 5)), expected)


class OnlyDlpack:
    """What a library has that knows no other protocol."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_an_array_on_the_host_may_come_by_dlpack_alone():
    assert_same(
        run(camera(), change=lambda hdr, motion: (OnlyDlpack(hdr), OnlyDlpack(motion))), run(camera())
    )
    strided = lambda hdr, motion: (OnlyDlpack(np.repeat(hdr, 2, 1)[:, ::2]), OnlyDlpack(motion))
    assert_same(run(camera(), change=strided), run(camera()))
    with pytest.raises(esaac.FrameError, match="hdr has dtype float64 x1, expected float16, float32"):
        camera().step(OnlyDlpack(np.zeros((24, 40, 4))), t_ns=0)


@pytest.mark.parametrize(("before", "after"), [("cubic", "bilinear"), ("bilinear", "cubic")])
def test_a_camera_whose_taps_have_changed_takes_its_own_state_back(before, after):
    cam = camera(taps=before)
    cam.step(*bars(40, 24, 0), t_ns=0)
    cam.sensor = cam.sensor.replace(taps=after)
    steps = lambda indices: [cam.step(*bars(40, 24, index), t_ns=FRAME_NS * index) for index in indices]
    steps(range(1, 3))
    state = cam.save()
    expected = join(steps(range(3, 5)))
    cam.restore(state)
    assert_same(join(steps(range(3, 5))), expected)
    fresh = camera(taps=after)
    fresh.restore(state)
    cam.restore(fresh.save())
    assert_same(join(steps(range(3, 5))), expected)


def test_sensors_change_between_steps():
    cam = camera()
    cam.step(*bars(40, 24, 0), t_ns=0)
    many = len(cam.step(*bars(40, 24, 1), t_ns=FRAME_NS))
    cam.sensor = cam.sensor.replace(contrast_on=0.6, contrast_off=0.6)
    few = len(cam.step(*bars(40, 24, 2), t_ns=2 * FRAME_NS))
    assert 0 < few < many / 2
    assert cam.sensor.contrast_on == 0.6
    with pytest.raises(esaac.ArgumentError, match="cannot become"):
        cam.sensor = cam.sensor.replace(width=41)


def test_aps_statistics_and_memory_are_reported():
    cam = camera(aps_exposure_ns=10_000_000, aps_bits=10)
    assert cam.aps is None
    for index in range(2):
        hdr, motion = bars(40, 24, index)
        hdr[3, 4] = np.nan
        cam.step(hdr, motion, t_ns=FRAME_NS * index)
    assert cam.aps.pixels.shape == (24, 40) and cam.aps.bits == 10 and cam.aps.pixels.max() <= 1023
    assert cam.aps.t_ns == 10_000_000
    statistics = cam.statistics
    assert statistics["invalid_pixels"] == 1 and statistics["unarmed_pixels"] == 1
    assert statistics["host_copies"] == 4 and statistics["device_copies"] == 0 and statistics["gpu_ns"] > 0
    assert 0 < statistics["frames_ns"] < statistics["step_ns"] - statistics["submit_to_packet_ns"]
    uses = cam.memory()
    assert sum(use["bytes"] for use in uses) > 40 * 24 * 8 and {use["camera"] for use in uses} >= {0, None}


def test_sensor_models_are_values():
    sensor = esaac.SensorModel("davis346", contrast_on=0.25, intensity="bayer_rggb", substeps=np.int32(16))
    assert (sensor.width, sensor.contrast_on, sensor.intensity, sensor.substeps) == (
        346,
        0.25,
        "bayer_rggb",
        16,
    )
    assert esaac.SensorModel.from_toml(sensor.to_toml()) == sensor == pickle.loads(pickle.dumps(sensor))
    assert sensor.replace(seed=7) != sensor and sensor.replace(seed=7).seed == 7
    assert repr(sensor).startswith('SensorModel("davis346"') and "contrast_on=0.25" in repr(sensor)
    names = [name for name, _, _ in esaac.SensorModel.parameters()]
    assert list(sensor.to_dict()) == names and set(names) <= set(dir(sensor))
    assert ("genx320", 320, 320) in [preset[:3] for preset in esaac.SensorModel.presets()]
    noisy = esaac.SensorModel("dvs128", profile="noisy", leak_rate_hz=0)
    assert noisy.shot_noise_rate_hz == 5.0 and noisy.leak_rate_hz == 0


def test_a_physical_pixel_has_the_numbers_of_its_preset():
    assert esaac.lux_per_unit("luminance", 2.0) == pytest.approx(0.9 * np.pi / 16)
    assert esaac.lux_per_unit("radiance", 2.0, transmission=0.45) == pytest.approx(270 * 0.45 * np.pi / 16)
    for unit, f_number, message in [("nits", 2.0, "expected luminance"), ("radiance", 0.0, "F-number is 0")]:
        with pytest.raises(esaac.ArgumentError, match=message):
            esaac.lux_per_unit(unit, f_number)
    hd = esaac.SensorModel("hd", pixel="physical", lux_per_unit=10.0)
    assert (hd.pixel, hd.refractory_ns, hd.leak_rate_hz, hd.lux_per_unit) == ("physical", 79_000, -0.06, 10.0)
    assert hd == esaac.SensorModel.from_toml(hd.to_toml()) and 'pixel="physical"' in repr(hd)
    quiet = esaac.SensorModel("hd", profile="clean", pixel="physical")
    assert (quiet.pixel, quiet.noise_gain, quiet.refractory_ns) == ("physical", 0.0, 0)
    assert repr(hd) == 'SensorModel("hd", pixel="physical", lux_per_unit=10.0)'
    bright = hd.replace(contrast_on=0.2)
    assert eval(repr(bright), vars(esaac)) == bright, "a value that the log pixel has too"
    with pytest.raises(esaac.SensorError) as caught:
        esaac.SensorModel("hd", pixel="physical", temperature_c=200.0)
    assert caught.value.parameter == "temperature_c" and "-40 to 125" in caught.value.expected

    physical = esaac.SensorModel("dvs128", pixel="physical", width=32, height=16, synthesis="linear")
    with esaac.EventCamera(physical) as cam:
        frames = [np.full((16, 32, 4), value, np.float32) for value in (0.1, 0.1, 1.0)]
        assert cam.light == [] and cam.light_warnings == []
        events = [len(cam.step(frame, t_ns=k * 50_000_000)) for k, frame in enumerate(frames)]
        (light,) = cam.light
        assert light["median_lux"] == pytest.approx(10.0, rel=0.05) and light["frames"] == 3
        assert light["high_lux"] == pytest.approx(100.0, rel=0.05) and light["dim_share"] == 0.0
        assert cam.light_warnings == [[]]
        # A lamp of 900 Hz needs 360 sub-steps in 50 ms.
        cam.sensor = physical.replace(flicker_depth=0.5, flicker_hz=900.0)
        assert "needs 360 sub-steps" in cam.light_warnings[0][0]
    assert events[0] == 0 and events[2] > 5 * 16 * 32


@pytest.mark.parametrize("profile", [None, "noisy"])
def test_another_pixel_takes_the_numbers_of_the_preset_and_leaves_those_of_the_user(profile):
    own = {"contrast_on": 0.31, "dark_lux": 0.9, "seed": 7}
    log = esaac.SensorModel("hd", profile=profile, **own)
    physical = esaac.SensorModel("hd", profile=profile, pixel="physical", **own)
    assert log.replace(pixel="physical") == esaac.SensorModel(log, pixel="physical") == physical
    assert physical.replace(pixel="log") == log
    # What comes in the same call stays, though it is what the log pixel has.
    assert log.replace(contrast_off=0.2, pixel="physical") == physical.replace(contrast_off=0.2)
    mine = esaac.SensorModel("hd", name="mine")
    assert mine.replace(pixel="physical").refractory_ns == 0, "no preset's name"


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.float16, np.array])
def test_numbers_of_numpy_are_numbers(kind):
    sensor = esaac.SensorModel("dvs128", contrast_on=kind(0.25))
    assert sensor.contrast_on == 0.25 and sensor.replace(contrast_on=kind(0.5)).contrast_on == 0.5
    for whole in (np.int64, np.uint8, np.array):
        assert sensor.replace(substeps=whole(16), leak_rate_hz=whole(1)).substeps == 16
    with pytest.raises(esaac.SensorError, match="contrast_on.*nan|contrast_on.*NaN"):
        esaac.SensorModel("dvs128", contrast_on=kind(np.nan))


@pytest.mark.parametrize(
    ("parameters", "parameter", "expected", "actual"),
    [
        ({"contrast_on": 0.0}, "contrast_on", "0.0001 to 10", "0"),
        ({"substeps": 65}, "substeps", "1 to 64", "65"),
        ({"intensity": "red"}, "intensity", "gray", "red"),
        ({"contrast_on": None}, "contrast_on", "a number", "None"),
        ({"substeps": True}, "substeps", "a number", "True"),
        ({"substeps": np.True_}, "substeps", "a number", "True"),
        ({"substeps": np.float64(2.5)}, "substeps", "a whole number", "2.5"),
        ({"contrast_on": np.array([0.1, 0.2])}, "contrast_on", "a number", "[0.1 0.2]"),
        ({"profile": "loud"}, "profile", "noisy", "loud"),
    ],
)
def test_a_wrong_parameter_is_named(parameters, parameter, expected, actual):
    with pytest.raises(esaac.SensorError) as caught:
        esaac.SensorModel("dvs128", **parameters)
    assert caught.value.parameter == parameter
    assert expected in caught.value.expected and actual in caught.value.actual
    assert isinstance(caught.value, ValueError)


def test_unknown_names_say_what_there_is():
    with pytest.raises(esaac.SensorError, match="contrast_one"):
        esaac.SensorModel(contrast_one=0.2)
    with pytest.raises(esaac.SensorError, match="genx320"):
        esaac.SensorModel("davis")
    with pytest.raises(AttributeError, match="contrast_one"):
        _ = esaac.SensorModel().contrast_one
