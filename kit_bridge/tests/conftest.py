"""Frames for the tests, and a device whose validation layer, if it watches, has nothing to say."""

import numpy as np
import pytest

import esaac

FRAME_NS = 33_333_333


@pytest.fixture(autouse=True)
def silent_validation():
    """A message of Vulkan's validation layer fails the test that caused it (ESAAC_VALIDATION=1)."""
    watcher = esaac.EventCamera("dvs128", width=8, height=8)
    before = len(watcher._engine.validation_messages())
    yield
    messages = watcher._engine.validation_messages()[before:]
    watcher.close()
    assert not messages, "\n".join(messages)


def bars(width, height, index, shift_px=2.0, dtype=np.float32):
    """Smooth bars that move right by `shift_px` a frame, and their motion vectors."""
    x = np.arange(width, dtype=np.float64) - shift_px * index
    row = 0.55 + 0.45 * np.sin(2 * np.pi * x / 16)
    hdr = np.empty((height, width, 4), dtype)
    hdr[...] = row[None, :, None]
    motion = np.zeros((height, width, 2), np.float32)
    motion[..., 0] = -shift_px
    return hdr, motion


def run(camera, count=4, width=40, height=24, change=lambda hdr, motion: (hdr, motion)):
    """Events of `count` frames as arrays x, y, t_ns, p."""
    packets = []
    for index in range(count):
        hdr, motion = change(*bars(width, height, index))
        packets.append(camera.step(hdr, motion, t_ns=FRAME_NS * index))
    return join(packets)


def join(packets):
    return tuple(
        np.concatenate([getattr(packet, name) for packet in packets]) for name in ("x", "y", "t_ns", "p")
    )


def assert_same(actual, expected):
    assert len(expected[0]) > 500
    for a, e in zip(actual, expected):
        np.testing.assert_array_equal(a, e)
