"""The extension `esaac.sim` on real USD stages and real Warp arrays, with stand-ins for Kit (see `stand_ins`)."""

import asyncio
import re
import types

import carb
import carb.settings
import numpy as np
import omni.kit.menu.utils
import omni.syntheticdata
import omni.ui
import omni.usd
import pytest
import warp as wp
from kit_stage import APP, EXTENSION, TIMELINE, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import Plug, Sdf, Usd, UsdGeom

import esaac
from esaac_sim import self_test, sinks
from esaac_sim.bridge import SETTINGS
from esaac_sim.closing import CloseError
from esaac_sim.extension import Extension
from esaac_sim.frames import FrameUnusable, frame_of
from esaac_sim.schema import API, SchemaError, cameras, spec_of
from esaac_sim.standalone import begin
from esaac_sim.texture import Texture


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        yield stage


def test_attributes_and_the_applied_schema_make_event_cameras(stage):
    assert Plug.Registry().GetPluginWithName("esaacSim")
    plain = UsdGeom.Camera.Define(stage, "/plain")
    applied = UsdGeom.Camera.Define(stage, "/applied").GetPrim()
    assert applied.ApplyAPI(API) and applied.HasAPI(API)
    assert applied.GetAttribute("esaac:sensor").Get() == "davis346"
    applied.GetAttribute("esaac:mode").Set("linear")
    camera(stage, "/off", enabled=False)
    specs, errors = cameras(stage)
    assert [spec.path for spec in specs] == ["/camera", "/applied"] and not errors
    assert (specs[0].sensor.width, specs[0].sensor.contrast_on, specs[0].topic) == (64, 0.15, "/camera")
    assert (specs[1].sensor.name, specs[1].sensor.synthesis, specs[1].packets) == (
        "davis346",
        "linear",
        "host",
    )
    assert not plain.GetPrim().HasAPI(API)
    # Defaults of the schema are those of a camera without it.
    bare = spec_of(camera(stage, "/bare", sensor="davis346", mode="linear"))
    assert bare.sensor == specs[1].sensor and bare.outputs == specs[1].outputs


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"sensor": "davis"}, "/wrong: .*genx320"),
        ({"sensr": "davis346"}, "/wrong: unknown attribute esaac:sensr, expected one of esaac:enabled"),
        ({"overrides": "contrast_on = 99"}, "/wrong: .*contrast_on.*99"),
        ({"overrides": "contrast_on"}, "line 1: `contrast_on`, expected `name = value`"),
        ({"outputs": ["frames"]}, "has `frames`, expected events"),
        ({"substeps": "many"}, "/wrong.esaac:substeps is `many`, expected a whole number"),
        ({"packets": "gpu"}, "is `gpu`, expected host or cuda"),
    ],
)
def test_wrong_attributes_name_prim_and_value(stage, attributes, message):
    prim = camera(stage, "/wrong", **attributes)
    with pytest.raises(SchemaError, match=message):
        spec_of(prim)
    running = bridge()
    assert running.attach(stage) == 1 and len(running.problems) == 1
    assert carb.LINES[-1][0] == "error" and "/wrong" in carb.LINES[-1][1]
    running.detach()


def test_a_moving_cube_sends_events_from_the_renderers_memory(stage):
    camera(
        stage,
        "/second",
        sensor="dvs128",
        overrides="width = 32\nheight = 24",
        outputs=["events", "voxel_grid", "aps"],
    )
    running = bridge()
    assert running.attach(stage) == 2
    move(stage, 20)
    first, second = running.feeds
    assert first.frames == 18 and first.unusable == 2 and not first.faults, first.message
    assert first.events > 200 and first.message == "running"
    assert (np.diff(first.packet.t_ns) >= 0).all() and first.packet.watermark_ns == round(19 / 60 * 1e9)
    assert set(second.forms) == {"voxel_grid", "aps"} and second.forms["aps"].pixels.shape == (24, 32)
    assert first.rates[0] > 0 and first.latency_ms > 0 and first.memory_bytes > 0
    # The same frames, without a bridge.
    alone = esaac.EventCamera(first.spec.sensor)
    again = Expected(stage, first.spec.sensor)
    move(stage, 3, first=20)
    assert again.events(alone) == first.packet.x.tolist()
    running.detach()
    again.close()
    assert not running.attached and not rep._PRODUCTS


class Expected:
    """A second writer on the same camera that copies what it is handed."""

    def __init__(self, stage, sensor):
        from esaac_sim.writer import EsaacEventWriter

        self.frames, self.sensor = [], sensor
        self.product = rep.create.render_product("/camera", (sensor.width, sensor.height))
        rep.faults.empty_frames = 0
        self.writer = EsaacEventWriter(self.keep)
        self.writer.attach([self.product])

    def keep(self, data):
        frame = frame_of(data, self.sensor.width, self.sensor.height)
        self.frames.append((frame.hdr.numpy().copy(), frame.motion.numpy().copy(), frame.t_ns))

    def events(self, cam):
        for hdr, motion, t_ns in self.frames:
            packet = cam.step(hdr, motion, t_ns=t_ns)
        return packet.x.tolist()

    def close(self):
        self.writer.detach()
        self.product.destroy()


def test_repeated_frames_rewinds_and_long_gaps_are_counted(stage):
    rep.faults.repeat = True
    running = bridge()
    running.attach(stage)
    move(stage, 8)
    feed = running.feeds[0]
    assert feed.duplicates == feed.frames and feed.gaps == 0
    rep._FRAME = 0
    move(stage, 3)
    assert feed.gaps == 1
    rep._FRAME = 600
    move(stage, 3)
    assert feed.gaps == 2 and feed.faults == 0, feed.message
    running.detach()


@pytest.mark.parametrize("suffix", [True, False])
def test_keys_with_and_without_the_products_name_are_found(stage, suffix):
    rep.faults.suffix = suffix
    running = bridge()
    running.attach(stage)
    move(stage, 6)
    assert running.feeds[0].frames == 4
    running.detach()


def test_frames_of_the_wrong_kind_are_told_and_skipped(stage):
    good = np.zeros((4, 5, 4), np.float16)
    data = {"HdrColor": good, "motion_vectors": good.astype(np.float32), "IsaacReadSimulationTime": 1.5}
    assert frame_of(data, 5, 4).t_ns == 1_500_000_000
    wrapped = {
        **data,
        "HdrColor": {"data": good, "info": {}},
        "IsaacReadSimulationTime": {"data": np.float64(2)},
    }
    assert frame_of(wrapped, 5, 4).t_ns == 2_000_000_000
    for change, message in (
        ({"HdrColor": good[..., :3]}, r"HdrColor has shape \(4, 5, 3\), expected \(4, 5, 4\)"),
        ({"motion_vectors": np.empty((0,))}, "motion_vectors is empty"),
        ({"IsaacReadSimulationTime": {"time": 1}}, r"keys \['time'\]"),
    ):
        with pytest.raises(FrameUnusable, match=message):
            frame_of({**data, **change}, 5, 4)
    del data["HdrColor"]
    with pytest.raises(FrameUnusable, match="no HdrColor among"):
        frame_of(data, 5, 4)


def checked(stage, **faults):
    carb.settings.get_settings().set(SETTINGS + "self_test", True)
    rep.faults.__dict__.update(faults)
    running = bridge()
    before = TIMELINE.is_playing(), TIMELINE.is_stopped(), TIMELINE.get_current_time()
    assert asyncio.run(running.self_test(APP, stage))
    assert not stage.GetPrimAtPath("/EsaacSelfTest") and not rep._PRODUCTS
    assert (TIMELINE.is_playing(), TIMELINE.is_stopped()) == before[:2]
    assert TIMELINE.is_playing() or TIMELINE.get_current_time() == before[2]
    return running, {check.name: check for check in running.checks}


def test_the_self_test_passes_on_a_renderer_that_keeps_its_word(stage):
    running, checks = checked(stage)
    assert set(checks) == {"frames", "motion", "light", "clock", "rate", "memory"}
    assert all(check.holds for check in checks.values()), checks
    asyncio.run(running.self_test(APP, stage))
    assert running.attach(stage) == 1 and not running.problems
    running.detach()


@pytest.mark.parametrize("before", ["stopped", "paused", "playing"])
def test_the_self_test_plays_the_timeline_and_leaves_it_as_it_was(stage, before):
    if before != "stopped":
        move(stage, 3)
    if before == "paused":
        TIMELINE.pause()
        APP.update()
        assert not TIMELINE.is_playing() and TIMELINE.get_current_time() > 0
    _, checks = checked(stage)
    assert len(checks) == 6 and all(check.holds for check in checks.values()), checks


def test_a_self_test_that_somebody_stops_is_made_again(stage):
    carb.settings.get_settings().set(SETTINGS + "self_test", True)
    running = bridge()
    updates = iter(range(1000))

    class Impatient:
        async def next_update_async(self):
            if next(updates) == 4:
                TIMELINE.stop()
            APP.update()

    assert not asyncio.run(running.self_test(Impatient(), stage))
    assert TIMELINE.is_stopped() and not running.checks and "stopped" in carb.LINES[-1][1]
    assert not stage.GetPrimAtPath("/EsaacSelfTest") and not rep._PRODUCTS
    assert asyncio.run(running.self_test(APP, stage))
    assert len(running.checks) == 6 and all(check.holds for check in running.checks)


def test_a_replicator_that_does_not_capture_on_play_is_told(stage):
    rep.orchestrator.set_capture_on_play(False)
    running, checks = checked(stage)
    assert "capture on play" in checks["frames"].message and running.attach(stage) == 0


def test_standalone_scripts_begin_with_a_passed_self_test_and_a_stopped_timeline(stage):
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    try:
        rep.orchestrator.set_capture_on_play(False)
        running, begun = begin(lambda: loop.run_until_complete(asyncio.sleep(0)), self_test=True)
    finally:
        asyncio.set_event_loop(None)
        loop.close()
    assert len(running.checks) == 6 and all(check.holds for check in running.checks), running.checks
    assert begun is stage and TIMELINE.is_stopped()
    assert running.attach(stage) == 1 and not running.problems
    move(stage, 6)
    assert running.feeds[0].frames == 4
    running.detach()


def test_attaching_by_hand_while_the_timeline_stands_keeps_the_cameras(stage):
    async def session():
        carb.settings.get_settings().set(SETTINGS + "self_test", True)
        extension = Extension()
        extension.on_startup("esaac.sim")
        assert await extension.attach() == 1
        assert TIMELINE.is_stopped() and all(check.holds for check in extension.bridge.checks)
        APP.update()
        assert extension.bridge.attached
        move(stage, 6)
        assert extension.bridge.feeds[0].frames == 4
        extension.on_shutdown()

    asyncio.run(session())


def test_wrong_motion_vectors_switch_the_synthesis(stage):
    running, checks = checked(stage, negate_motion=True)
    assert not checks["motion"].holds and "they are negated" in checks["motion"].message
    assert running.attach(stage) == 1
    assert "mode `linear` is used" in running.problems[0]
    assert running.feeds[0].spec.sensor.synthesis == "linear"
    running.detach()


def test_the_texture_path_is_taken_only_where_the_self_test_has_passed(stage):
    settings = carb.settings.get_settings()
    settings.set(SETTINGS + "path", "texture")
    # The self-test is off: nobody knows.
    running = bridge()
    assert running.attach(stage) == 1 and running.feeds[0].texture is None
    assert "has not passed the self-test, so the annotator's array is used" in running.problems[0]
    running.detach()
    if wp.is_cuda_available():
        # Tests of `on_cuda` go on from here.
        return
    running, checks = checked(stage)
    assert checks["texture"].message == "HdrColorPtr lies on the host, expected a CUDA device"
    assert not checks["texture"].holds and all(c.holds for n, c in checks.items() if n != "texture")
    assert running.attach(stage) == 1 and running.feeds[0].texture is None and len(running.problems) == 1
    move(stage, 6)
    assert running.feeds[0].frames == 4
    running.detach()


def test_a_curve_a_stopped_clock_and_empty_frames_are_told(stage):
    running, checks = checked(stage, gamma=True)
    assert not checks["light"].holds and "exposure or a curve" in checks["light"].message
    assert running.attach(stage) == 1 and len(running.problems) == 1
    assert "/camera: the renderer's light failed the self-test" in running.problems[0]
    running.detach()
    running, checks = checked(stage, gamma=False, stopped_clock=True)
    assert not checks["clock"].holds
    stage.GetPrimAtPath("/camera").CreateAttribute("esaac:publish", Sdf.ValueTypeNames.Bool).Set(True)
    running.attach(stage)
    assert "nothing is published" in running.problems[0]
    running.detach()
    running, checks = checked(stage, stopped_clock=False, empty_frames=1000)
    assert not checks["frames"].holds and running.attach(stage) == 0
    assert "no camera is attached" in running.problems[0]


def test_recordings_are_files_when_the_run_ends(stage, tmp_path):
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
    running = bridge()
    running.attach(stage)
    move(stage, 12)
    events = running.feeds[0].events
    running.detach()
    assert len(np.load(tmp_path / "camera.npz")["t"]) == events > 100


def test_a_timeline_that_is_rewound_begins_another_file(stage, tmp_path):
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
    running = bridge()
    running.attach(stage)
    (feed,) = running.feeds
    move(stage, 12)
    first = feed.events
    rep._FRAME = 0
    move(stage, 12)
    assert feed.gaps == 1 and feed.faults == 0, feed.message
    second = feed.events - first
    running.detach()
    for name, events in (("camera.npz", first), ("camera_2.npz", second)):
        times = np.load(tmp_path / name)["t"]
        assert len(times) == events > 100 and (np.diff(times) >= 0).all()


def test_no_recording_is_overwritten(stage, tmp_path):
    UsdGeom.Xform.Define(stage, "/a")
    for path in ("/a/eye", "/a_eye"):
        camera(stage, path, sensor="dvs128", overrides="width = 64\nheight = 48")
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
    running, events = bridge(), {}
    for names in (("camera", "a_eye", "a_eye_2"), ("camera_2", "a_eye_3", "a_eye_4")):
        assert running.attach(stage) == 3
        move(stage, 8)
        for name, feed in zip(names, running.feeds):
            assert feed.spec.path in ("/camera", "/a/eye", "/a_eye")
            events[tmp_path / f"{name}.npz"] = feed.events
            assert (
                "info",
                f"[esaac.sim] {feed.spec.path}: events are recorded as {tmp_path / name}.npz",
            ) in carb.LINES
        running.detach()
        assert carb.LINES[-1][1].endswith(f"events are saved as {tmp_path / names[-1]}.npz")
        TIMELINE.stop()
        APP.update()
    assert {path: len(np.load(path)["t"]) for path in tmp_path.iterdir()} == events
    # Without a frame there is no recording.
    assert running.attach(stage) == 3
    running.detach()
    assert set(tmp_path.iterdir()) == set(events)


def test_a_file_that_appears_while_a_recording_runs_stays(stage, tmp_path):
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
    running = bridge()
    running.attach(stage)
    move(stage, 8)
    (tmp_path / "camera.npz").write_text("another's")
    running.detach()
    assert (tmp_path / "camera.npz").read_text() == "another's" and len(
        np.load(tmp_path / "camera_2.npz")["t"]
    )


def test_a_sensor_that_is_changed_begins_another_file(stage, tmp_path):
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
    running = bridge()
    running.attach(stage)
    (feed,) = running.feeds
    # Before the first event the file is still empty.
    feed.change(contrast_on=0.2)
    move(stage, 12)
    first = feed.events
    feed.change(contrast_on=0.1)
    move(stage, 12, first=12)
    running.detach()
    assert {path.name for path in tmp_path.iterdir()} == {"camera.npz", "camera_2.npz"}
    for name, events, contrast_on in (("camera", first, 0.2), ("camera_2", feed.events - first, 0.1)):
        recording = np.load(tmp_path / f"{name}.npz")
        sensor = esaac.SensorModel.from_toml(str(recording["sensor"]))
        assert len(recording["t"]) == events > 50 and sensor.contrast_on == contrast_on


class Broken:
    """A sink that cannot be closed."""

    def __call__(self, feed, packet):
        pass

    def close(self):
        raise RuntimeError("cannot close")


def test_a_recording_that_fails_keeps_its_events_and_spoils_nothing_else(stage, tmp_path):
    camera(stage, "/second", sensor="dvs128", overrides="width = 64\nheight = 48")
    settings = carb.settings.get_settings()
    settings.set("/rtx/post/aa/op", 3)
    settings.set(SETTINGS + "record", str(tmp_path / "first"))
    running = bridge()
    assert running.attach(stage) == 2
    first, second = running.feeds
    second.sinks[0] = sinks.Recorder(tmp_path / "second", second.spec)
    first.sinks.insert(0, Broken())
    move(stage, 12)
    (tmp_path / "first").rmdir()
    with pytest.raises(CloseError, match="RuntimeError: cannot close; OSError: .*no folder") as caught:
        running.detach()
    assert len(caught.value.exceptions) == 2
    # Everything else is closed and saved.
    assert first.camera.closed and second.camera.closed and not running.attached and not rep._PRODUCTS
    assert settings.get("/rtx/post/aa/op") == 3
    assert len(np.load(tmp_path / "second/second.npz")["t"]) == second.events > 50
    # The events of the other are not lost.
    assert [len(recorder) for recorder in running.unsaved] == [first.events]
    assert running.save_unsaved() == 1 and "no folder" in running.problems[-1]
    settings.set(SETTINGS + "record", str(tmp_path))
    assert running.save_unsaved() == 0 and running.unsaved == []
    assert len(np.load(tmp_path / "camera.npz")["t"]) == first.events > 50


def test_a_folder_that_cannot_be_written_is_told_when_cameras_attach(stage, tmp_path):
    (tmp_path / "file").write_text("no folder")
    carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path / "file"))
    running = bridge()
    assert running.attach(stage) == 0 and str(tmp_path / "file") in running.problems[0]
    assert not running.attached and not rep._PRODUCTS
    running.detach()


def test_the_window_saves_again_what_could_not_be_saved_at_stop(stage, tmp_path):
    async def session():
        folder = tmp_path / "recordings"
        carb.settings.get_settings().set(SETTINGS + "record", str(folder))
        extension = Extension()
        extension.on_startup("esaac.sim")
        extension.show()
        await extension.attach()
        move(stage, 12)
        events = extension.bridge.feeds[0].events
        folder.rmdir()
        TIMELINE.stop()
        APP.update()
        APP.update()
        shown = extension.window._problems.text
        assert "no folder" in shown and f"not saved: {events} events of {folder}/camera.npz" in shown
        folder.mkdir()
        (again,) = (button for button in omni.ui.BUTTONS if button.text == "Save again")
        again.click()
        APP.update()
        assert "not saved" not in extension.window._problems.text
        assert len(np.load(folder / "camera.npz")["t"]) == events > 50
        extension.on_shutdown()

    asyncio.run(session())


def test_a_fault_in_a_sink_ends_nothing(stage):
    running = bridge()
    running.attach(stage)
    feed = running.feeds[0]
    feed.sinks.append(lambda feed, packet: 1 / 0)
    move(stage, 6)
    assert feed.frames == 4 and feed.faults == 4 and "division by zero" in feed.message
    feed.sinks[-1] = types.SimpleNamespace(restart=lambda: 1 / 0)
    rep._FRAME = 0
    move(stage, 1)
    # The restart failed, and so did the call: this sink cannot be called.
    assert feed.gaps == 1 and feed.frames == 5 and feed.faults == 6
    running.detach()


def test_exposure_is_pinned_while_cameras_run_and_given_back(stage):
    settings = carb.settings.get_settings()
    settings.set("/rtx/post/aa/op", 3)
    running = bridge()
    running.attach(stage)
    assert settings.get("/rtx/post/aa/op") == 0 and settings.get("/rtx/post/histogram/enabled") is False
    running.detach()
    assert settings.get("/rtx/post/aa/op") == 3


def test_the_extension_follows_the_timeline_and_shows_its_window(stage):
    async def session():
        extension = Extension()
        extension.on_startup("esaac.sim")
        item = omni.kit.menu.utils.MENUS["Window"][-1]
        assert item.name == "Event cameras"
        TIMELINE.play()
        APP.update()
        assert await extension._task == 1
        item.onclick_fn()
        APP.update()
        move(stage, 12)
        window, feed = extension.window, extension.bridge.feeds[0]
        (row,) = window._rows
        assert "running" in row[1].text and "64x48" in row[1].text
        assert row[3].data and min(row[3].data) < 255
        # A picture that nobody sees is not made.
        window.visible, row[3].data = False, None
        before = row[2].rgba
        move(stage, 6, first=12)
        assert row[3].data is None and (row[2].rgba == before).all() and feed.events > 100
        window.visible = True
        slider = omni.ui.SLIDERS[0]
        slider.model.edit(0.5)
        assert feed.camera.sensor.contrast_on == 0.5
        slider.model.edit(99.0)
        assert "contrast_on" in feed.message and feed.camera.sensor.contrast_on == 0.5
        TIMELINE.stop()
        APP.update()
        assert not extension.bridge.attached and feed.camera.closed
        APP.update()
        extension.on_shutdown()
        assert item not in omni.kit.menu.utils.MENUS["Window"] and window._window.destroyed

    asyncio.run(session())


def test_cameras_are_detached_when_their_stage_closes(stage, tmp_path):
    async def session():
        carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
        extension, context = Extension(), omni.usd.get_context()
        extension.on_startup("esaac.sim")
        await extension.attach()
        (feed,) = extension.bridge.feeds
        move(stage, 8)
        other = Usd.Stage.CreateInMemory()
        camera(other, "/other", sensor="dvs128", overrides="width = 64\nheight = 48")
        context.open(other)
        assert feed.camera.closed and not extension.bridge.attached and not rep._PRODUCTS
        assert len(np.load(tmp_path / "camera.npz")["t"]) == feed.events > 50
        assert "the stage was closed" in extension.bridge.problems[-1] and carb.LINES[-1][0] == "error"
        # Its events may come late, or never: play looks.
        await extension.attach()
        context.stage = stage
        TIMELINE.stop()
        APP.update()
        await extension.attach()
        context.stage = other
        TIMELINE.play()
        APP.update()
        assert await extension._task == 1 and extension.bridge.stage == other
        assert [feed.spec.path for feed in extension.bridge.feeds] == ["/other"]
        # A stage without cameras of ours is none of our business.
        TIMELINE.stop()
        APP.update()
        extension.bridge.problems.clear()
        context.open(stage)
        assert not extension.bridge.problems
        extension.on_shutdown()

    asyncio.run(session())


def test_a_self_test_ends_when_its_stage_closes(stage, monkeypatch):
    async def later(app):
        await asyncio.sleep(0)
        app.update()

    monkeypatch.setattr(type(APP), "next_update_async", later)

    async def session():
        carb.settings.get_settings().set(SETTINGS + "self_test", True)
        extension = Extension()
        extension.on_startup("esaac.sim")
        task = extension.attach()
        for _ in range(4):
            await asyncio.sleep(0)
        assert stage.GetPrimAtPath("/EsaacSelfTest")
        omni.usd.get_context().open(Usd.Stage.CreateInMemory())
        with pytest.raises(asyncio.CancelledError):
            await task
        assert not stage.GetPrimAtPath("/EsaacSelfTest") and TIMELINE.is_stopped() and not rep._PRODUCTS
        extension.on_shutdown()

    asyncio.run(session())


def test_what_fails_while_cameras_attach_is_told(stage, monkeypatch):
    async def session():
        settings = carb.settings.get_settings()
        settings.set("/rtx/post/aa/op", 3)
        extension = Extension()
        extension.on_startup("esaac.sim")
        monkeypatch.setattr(rep.create, "render_product", lambda *_: 1 / 0)
        assert await extension.attach() == 0
        told = "cameras are not attached: ZeroDivisionError: division by zero"
        assert extension.bridge.problems == [told] and carb.LINES[-1] == ("error", f"[esaac.sim] {told}")
        assert not extension.bridge.attached and settings.get("/rtx/post/aa/op") == 3
        extension.on_shutdown()

    asyncio.run(session())


def test_the_extensions_files_are_those_that_it_names():
    import tomllib

    config = tomllib.loads((EXTENSION / "config/extension.toml").read_text())
    package = config["package"]
    for file in ("readme", "changelog", "preview_image", "icon"):
        assert (EXTENSION / package[file]).is_file(), file
    assert (EXTENSION / config["python"]["module"][0]["name"] / "__init__.py").is_file()
    assert f"## {package['version']}" in (EXTENSION / package["changelog"]).read_text()
    # No stranger's package of the same name, and no other NumPy than Kit's.
    pip = config["python"]["pipapi"]
    assert pip["requirements"] == ["esaac"] and {"--no-index", "--no-deps"} <= set(pip["extra_args"])
    named = {name for table in config["settings"]["exts"].values() for name in table}
    used = (EXTENSION / "esaac_sim").rglob("*.py")
    text = "".join(path.read_text() for path in used)
    assert named == {name for name in named if f'setting("{name}"' in text}


@pytest.mark.parametrize("background", [0.0, 1.0, 500.0])
def test_the_self_test_knows_the_cube_before_any_background(stage, monkeypatch, background):
    monkeypatch.setattr(rep, "BACKGROUND", background)
    _, checks = checked(stage)
    assert all(check.holds for check in checks.values()), checks
    _, checks = checked(stage, gamma=True, negate_motion=True)
    assert {name for name, check in checks.items() if not check.holds} == {"light", "motion"}, checks


def test_the_cube_is_judged_where_it_is_drawn():
    width, height = self_test.SIZE_PX
    rows, columns = self_test.cube_px()
    assert 20 < rows.stop - rows.start < 42 and 20 < columns.stop - columns.start < 42
    frames = []
    for index in range(self_test.FRAMES):
        hdr, motion = np.full((height, width, 4), 500.0), np.full((height, width, 4), 9.0)
        hdr[rows, columns] = self_test.RADIANCE[index >= self_test.FRAMES // 2]
        motion[rows, columns, :2] = self_test.expected_motion_px()
        # Something that is not at rest, so that images differ.
        hdr[0, 0] += index
        time = {"simulationTime": index / self_test.RATE_HZ}
        frames.append({"HdrColor": hdr, "motion_vectors": motion, "IsaacReadSimulationTime": time})
    assert not [check for check in self_test.judge(frames) if not check.holds]


def test_every_check_says_what_it_switches_off():
    frames = [{}]
    (check,) = self_test.judge(frames)
    assert not check.holds and self_test.disabled([check]) == {"everything"}
    assert sinks.Recorder.name == "recorder"
    # What a check switches off, the bridge looks at.
    package = EXTENSION / "esaac_sim"
    tests = "".join(path.read_text() for path in package.glob("self_test*.py"))
    given = re.findall(r"disables=([^,)]+)", tests)
    named = {name for value in given for name in re.findall(r'"(\w+)"', value)}
    assert {"everything", "motion", "light", "publish", "rate", "texture"} <= named
    bridge_py = (package / "bridge.py").read_text()
    assert named == {name for name in named if f'"{name}" in off' in bridge_py}


def test_a_texture_on_another_device_is_told(stage, monkeypatch):
    product = rep.create.render_product("/camera", (64, 48))
    told = {"dataPtr": 1, "cudaDeviceIndex": 1, "width": 64, "height": 48, "bufferSize": 0}
    told = {f"outputs:{name}": value for name, value in told.items()}
    monkeypatch.setattr(omni.syntheticdata.SyntheticData, "get_node_attributes", lambda *_: told)
    running = types.SimpleNamespace(device={"uuid": "a"})
    for cuda, own in ((0, "cuda:0"), (None, "no CUDA device")):
        monkeypatch.setattr(
            esaac, "devices", lambda cuda=cuda: [{"uuid": "b", "cuda": 1}, {"uuid": "a", "cuda": cuda}]
        )
        expected = (
            f"lies on cuda:1, expected the engine's device, which is {own}; set the extension's `device`"
        )
        with pytest.raises(FrameUnusable, match=expected):
            Texture(product, running).image(64, 48)
    running.device = {"uuid": "b"}
    assert isinstance(Texture(product, running).image(64, 48), esaac.CudaTexture)
