"""Recordings of the extension `esaac.sim`, on real USD stages with stand-ins for Kit (see `stand_ins`)."""

import asyncio

import carb
import carb.settings
import numpy as np
import omni.kit.menu.utils
import omni.syntheticdata
import omni.ui
import omni.usd
import pytest
from kit_stage import APP, TIMELINE, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import UsdGeom

import esaac
from esaac_sim import sinks
from esaac_sim.bridge import SETTINGS
from esaac_sim.closing import CloseError
from esaac_sim.extension import Extension


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        yield stage


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
