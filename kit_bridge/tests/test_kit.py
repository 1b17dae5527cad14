"""The extension `esaac.sim` on real USD stages and real Warp arrays, with stand-ins for Kit (see `stand_ins`)."""

import asyncio
import types

import carb
import carb.settings
import numpy as np
import omni.kit.menu.utils
import omni.syntheticdata
import omni.ui
import omni.usd
import pytest
from kit_stage import APP, EXTENSION, TIMELINE, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import Plug, Usd, UsdGeom

import esaac
from esaac_sim import self_test
from esaac_sim.bridge import SETTINGS
from esaac_sim.extension import Extension
from esaac_sim.frames import FrameUnusable, frame_of
from esaac_sim.schema import API, SchemaError, cameras, spec_of
from esaac_sim.texture import Texture
from esaac_sim.window import describe


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
    assert applied.GetAttribute("esaac:mode").Get() == "auto"
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
    plainest = spec_of(camera(stage, "/plainest", sensor="davis346"))
    assert plainest.sensor.synthesis == "auto" and plainest.with_motion and plainest.with_geometry
    # The profile is that of the pixel that the overrides choose.
    for profile in ("clean", "noisy"):
        physical = camera(stage, f"/{profile}", sensor="hd", profile=profile, overrides="pixel = physical")
        expected = esaac.SensorModel("hd", profile=profile, pixel="physical", substeps=32)
        assert spec_of(physical).sensor == expected and expected.noise_gain == float(profile == "noisy")


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


def test_settings_that_had_no_value_have_none_again(stage):
    settings = carb.settings.get_settings()
    settings.set("/rtx/post/aa/op", 3)
    before = dict(settings)
    running = bridge()
    running.attach(stage)
    assert settings.get("/rtx/post/tonemap/fStop") == 1.0
    running.detach()
    assert settings == before


def test_a_camera_whose_texture_cannot_be_had_leaves_nothing_behind(stage, monkeypatch):
    carb.settings.get_settings().set(SETTINGS + "path", "texture")

    def refuse(product, camera):
        raise FrameUnusable("no texture")

    monkeypatch.setattr("esaac_sim.bridge.Texture", refuse)
    running = bridge()
    running.checks = [self_test.Check("texture", True, "the same events both ways")]
    assert running.attach(stage) == 0 and running.problems == ["/camera: no texture"]
    assert not rep._PRODUCTS and not running.attached
    move(stage, 6)
    running.detach()


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


@pytest.mark.filterwarnings("ignore::esaac.LightWarning")
def test_a_camera_with_physical_pixels_is_shown_with_its_light(stage):
    running = bridge()
    running.attach(stage)
    move(stage, 6)
    assert "lux" not in describe(running.feeds[0])
    running.detach()
    overrides = "width = 64\nheight = 48\npixel = physical\nflicker_depth = 0.5\nflicker_hz = 900"
    stage.GetPrimAtPath("/camera").GetAttribute("esaac:overrides").Set(overrides)
    assert running.attach(stage) == 1, running.problems
    (feed,) = running.feeds
    assert "lux" not in describe(feed), "no frame yet"
    move(stage, 6, first=6)
    *_, light, warning = describe(feed).splitlines()
    (report,) = feed.camera.light
    assert light.startswith(f"light on the sensor {report['median_lux']:.3g} lux, nine tenths of the pixels")
    assert warning == f"light: {feed.camera.light_warnings[0][0]}" and "sub-steps" in warning
    running.detach()


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
