"""Steps that are submitted: the caller goes on, and takes the packets later."""

import threading

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join

import esaac

SENSOR = esaac.SensorModel(
    "dvs128", width=40, height=24, contrast_on=0.15, contrast_off=0.15, profile="noisy"
)


def tiles(count, index):
    pairs = [bars(40, 24, index + 0.3 * env) for env in range(count)]
    return np.stack([hdr for hdr, _ in pairs]), np.stack([motion for _, motion in pairs])


@pytest.mark.parametrize("packets", ["host", "mapped"])
def test_submitted_steps_give_the_packets_of_steps(packets):
    stepped, submitted = [], []
    with (
        esaac.EventCamera(SENSOR, packets=packets) as one,
        esaac.EventCamera(SENSOR, packets=packets) as other,
    ):
        for index in range(4):
            hdr, motion = bars(40, 24, index)
            stepped.append(columns(one.step(hdr, motion, t_ns=FRAME_NS * index)))
            assert other.submit(hdr, motion, t_ns=FRAME_NS * index) is None
            # The engine has its own copy by now.
            hdr[:] = 0
            packet = other.packet()
            assert other.last_packet is packet
            submitted.append(columns(packet))
            counts = [
                {k: v for k, v in cam.statistics.items() if not k.endswith("_ns")} for cam in (one, other)
            ]
            assert counts[0] == counts[1]
    assert_same(joined(submitted), joined(stepped))


def columns(packet):
    """Copies: a mapped packet is the camera's until its next step but one."""
    return tuple(np.array(getattr(packet, name)) for name in ("x", "y", "t_ns", "p"))


def joined(parts):
    return tuple(np.concatenate([part[i] for part in parts]) for i in range(4))


def test_rigs_and_environments_submit_too():
    sensors = [SENSOR.replace(seed=3), SENSOR.replace(seed=4)]
    with esaac.Rig(sensors) as one, esaac.Rig(sensors) as other:
        expected, actual = [], []
        for index in range(4):
            frames = [bars(40, 24, index), bars(40, 24, index + 0.4)]
            expected.append(join(one.step(frames, FRAME_NS * index)))
            other.submit(frames, FRAME_NS * index)
            actual.append(join(other.packets()))
            assert other.last_packets[1].sequence == index
        assert_same(joined(actual), joined(expected))
    with esaac.TiledEventCamera(SENSOR, 3) as one, esaac.TiledEventCamera(SENSOR, 3) as other:
        for index in range(3):
            hdr, motion = tiles(3, index)
            times = [FRAME_NS * index] * 3 if index != 1 else [FRAME_NS, None, FRAME_NS]
            expected = one.step(hdr, motion, t_ns=times)
            other.submit(hdr, motion, t_ns=np.array(times, object))
            actual = other.packet()
            np.testing.assert_array_equal(actual.offsets, expected.offsets)
            np.testing.assert_array_equal(actual.t_ns, expected.t_ns)
        assert len(actual) > 500


def test_one_step_is_under_way_at_a_time():
    with esaac.EventCamera(SENSOR) as cam:
        with pytest.raises(esaac.ArgumentError, match="no step was submitted"):
            cam.packet()
        cam.submit(*bars(40, 24, 0), t_ns=0)
        for call in (cam.submit, cam.step):
            with pytest.raises(esaac.ArgumentError, match=r"expected packet\(\) first"):
                call(*bars(40, 24, 1), t_ns=FRAME_NS)
        assert len(cam.packet()) == 0
        with pytest.raises(esaac.ArgumentError, match="no step was submitted"):
            cam.packet()
        assert len(cam.step(*bars(40, 24, 1), t_ns=FRAME_NS)) > 0


def test_a_wrong_frame_is_told_at_once_and_changes_nothing():
    with esaac.EventCamera(SENSOR) as cam:
        cam.step(*bars(40, 24, 0), t_ns=FRAME_NS)
        with pytest.raises(esaac.FrameError, match="frame time 0 ns"):
            cam.submit(*bars(40, 24, 1), t_ns=0)
        with pytest.raises(esaac.FrameError, match="hdr has shape"):
            cam.submit(bars(41, 24, 1)[0], t_ns=2 * FRAME_NS)
        with pytest.raises(esaac.ArgumentError, match="no step was submitted"):
            cam.packet()
        assert len(cam.step(*bars(40, 24, 1), t_ns=2 * FRAME_NS)) > 0


def test_other_calls_wait_for_the_step():
    with esaac.EventCamera(SENSOR) as cam:
        cam.step(*bars(40, 24, 0), t_ns=0)
        cam.submit(*bars(40, 24, 1), t_ns=FRAME_NS)
        # These are of the step that was submitted, and it had the old threshold.
        cam.sensor = cam.sensor.replace(contrast_on=0.3)
        counts, state = cam.event_frame(), cam.save()
        packet = cam.packet()
        assert counts.sum() == len(packet) > 0
        cam.submit(*bars(40, 24, 2), t_ns=2 * FRAME_NS)
        after = join([cam.packet()])
    with esaac.EventCamera(SENSOR.replace(contrast_on=0.3)) as again:
        again.restore(state)
        expected = join([again.step(*bars(40, 24, 2), t_ns=2 * FRAME_NS)])
    for a, e in zip(after, expected):
        np.testing.assert_array_equal(a, e)


def test_a_step_may_be_taken_by_another_thread_or_never():
    cam = esaac.EventCamera(SENSOR)
    cam.step(*bars(40, 24, 0), t_ns=0)
    cam.submit(*bars(40, 24, 1), t_ns=FRAME_NS)
    taken = []
    thread = threading.Thread(target=lambda: taken.append(cam.packet()))
    thread.start()
    thread.join(30)
    assert len(taken[0]) > 0
    cam.submit(*bars(40, 24, 2), t_ns=2 * FRAME_NS)
    cam.close()
    with pytest.raises(esaac.ArgumentError, match="no step was submitted"):
        cam.packet()
    with pytest.raises(esaac.ClosedError):
        cam.submit(*bars(40, 24, 3), t_ns=3 * FRAME_NS)
    left = esaac.EventCamera(SENSOR)
    left.submit(*bars(40, 24, 0), t_ns=0)
    del left
