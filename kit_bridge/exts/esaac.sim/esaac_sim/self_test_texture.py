"""Tests whether the texture path may be used. Two cameras get the same frames, one from the annotator's array and one
from the texture. They must give the same events and the same APS frames."""

import numpy as np

import esaac

from .frames import HDR, TIME, FrameUnusable, find, payload, seconds
from .self_test import SIZE_PX, Check
from .texture import Texture

ENOUGH = 4
"""Frames that must be compared at least."""


class Twins:
    """One camera for each path."""

    def __init__(self, product, device):
        sensor = esaac.SensorModel("dvs128", width=SIZE_PX[0], height=SIZE_PX[1], synthesis="linear")
        # Events show only changes of light; APS frames show the light itself.
        sensor = sensor.replace(contrast_on=0.1, contrast_off=0.1, aps_exposure_ns=8_000_000, aps_bits=16)
        self._cameras = [esaac.EventCamera(sensor, device=device) for _ in range(2)]
        self._texture, self._fault = None, None
        self._frames = self._events = 0
        try:
            self._texture = Texture(product, self._cameras[0])
        except FrameUnusable as unusable:
            self._fault = str(unusable)

    def write(self, data):
        """Compares one frame. The writer calls this while the renderer's memory is valid."""
        if self._fault:
            return
        array = payload(find(data, HDR))
        if array is None or 0 in tuple(array.shape):
            return
        t_ns = round(seconds(find(data, TIME)) * 1e9)
        try:
            images = (array, self._texture.image(*SIZE_PX))
            packets = [cam.step(image, t_ns=t_ns) for cam, image in zip(self._cameras, images)]
        except FrameUnusable as unusable:
            self._fault = None if unusable.expected else str(unusable)
            return
        except esaac.EsaacError as error:
            self._fault = f"{type(error).__name__}: {error}"
            return
        for name in ("x", "y", "t_ns", "p"):
            if not np.array_equal(*(getattr(packet, name) for packet in packets)):
                counts = tuple(map(len, packets))
                self._fault = (
                    f"other events at {t_ns} ns: {counts[0]} by the annotator, {counts[1]} by the texture"
                )
                return
        aps = [cam.aps for cam in self._cameras]
        if None not in aps and not np.array_equal(*(frame.pixels for frame in aps)):
            self._fault = f"another APS frame at {t_ns} ns"
            return
        self._frames += 1
        self._events += len(packets[0])

    def check(self):
        told = f"{self._frames} frames and {self._events} events by both paths"
        if self._fault is None and (self._frames < ENOUGH or self._events == 0):
            self._fault = f"{told}, expected at least {ENOUGH} frames with events"
        return Check(
            "texture", not self._fault, self._fault or told, disables="texture" if self._fault else ""
        )

    def close(self):
        for cam in self._cameras:
            cam.close()
