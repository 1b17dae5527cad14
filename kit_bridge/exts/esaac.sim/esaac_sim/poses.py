"""World transforms of cameras and of what moves, recorded at every physics step, for synthesis `rigid`.

A *body* is a prim whose transform may change: one that physics moves, one with animated transforms, or one that a
script moves. A prim belongs to its nearest ancestor that is a body; a prim without one is the static world. Physics
writes its poses where USD does not see them, so those of rigid bodies are asked of it.
"""

import dataclasses
import math

import omni.timeline
from pxr import Gf, Tf, Usd, UsdGeom, UsdPhysics

import esaac

from .instances import Instances

STATIC_WORLD = -1

MOST_AHEAD_S = 0.1
"""The timeline moves once a frame, so it may be ahead of physics by a frame. By more than this it has jumped."""


class PosesUnusable(Exception):
    """Poses cannot be recorded here, and why."""


def recorded(spec, stage, transforms=None):
    """The camera as it is fed, what records the poses of its stage (`transforms`, if there is one already), and why
    mode `auto` does without poses, or None."""
    is_auto = spec.sensor.synthesis == "auto"
    if not spec.with_geometry:
        return spec, transforms, "the camera has no horizontal aperture" if is_auto else None
    try:
        return spec, transforms or Transforms(stage), None
    except PosesUnusable as unusable:
        if spec.with_ids:
            raise PosesUnusable(f"{unusable}; `event_ids` of esaac:outputs needs poses") from unusable
        if spec.needs_poses:
            raise
        return dataclasses.replace(spec, with_geometry=False), transforms, str(unusable)


class Transforms:
    """Records poses of a stage until it is closed. `instances` knows its prims by their ids."""

    def __init__(self, stage):
        try:
            from isaacsim.core.simulation_manager import SimulationManager
            from omni.physx import get_physx_interface
        except ImportError as error:
            raise PosesUnusable(f"poses need {error.name}, which is not enabled") from error
        self.instances = Instances(stage)
        self._stage, self._unit_m = stage, UsdGeom.GetStageMetersPerUnit(stage)
        self._clock, self._physics = SimulationManager, get_physx_interface()
        self._bodies, self._recorders, self._last_ns = {}, {}, None
        self._timeline = omni.timeline.get_timeline_interface()
        self._offset_s = math.inf
        self._follow_below(stage.GetPseudoRoot(), None)
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._changed, stage)
        self._subscription = self._physics.subscribe_physics_on_step_events(self._stepped, False, 0)

    def recorder(self, camera_path):
        """What `EventCamera.step` takes as `poses` for a camera of the stage."""
        return self._recorders.setdefault(camera_path, esaac.PoseRecorder(order="xyzw", axes="usd"))

    def table(self, labels, since_ns):
        """Which body each id of an image is, by its `labels`: paths of prims, or words for what is no prim. Bodies
        that began to move after `since_ns` are left out: where they were until then is not known."""
        table = {}
        for name, label in labels.items():
            if int(name) == 0 or not str(label).startswith("/"):
                continue
            body = self._body_of(str(label))
            if body is None:
                table[int(name)] = STATIC_WORLD
                continue
            number, first_ns = self._bodies[body]
            if first_ns is None or first_ns <= since_ns:
                table[int(name)] = number
        return table

    def close(self):
        """Ends the recording."""
        self._listener.Revoke()
        self._subscription.unsubscribe()
        self._recorders.clear()

    def _follow(self, path, first_ns):
        self._bodies.setdefault(path, (len(self._bodies), first_ns))

    def _follow_below(self, top, first_ns):
        """A prim and what is below it, as far as it is a rigid body or animated."""
        for prim in Usd.PrimRange(top):
            xformable = UsdGeom.Xformable(prim)
            if prim.HasAPI(UsdPhysics.RigidBodyAPI) or (
                xformable and xformable.TransformMightBeTimeVarying()
            ):
                self._follow(str(prim.GetPath()), first_ns)

    def _changed(self, notice, _stage):
        """USD tells of every change. Those of physics concern bodies that are followed already."""
        # The next sample is the first of a new body.
        first_ns = None if self._last_ns is None else self._last_ns + 1
        for path in notice.GetChangedInfoOnlyPaths():
            if path.IsPropertyPath() and path.name.startswith("xformOp"):
                self._follow(str(path.GetPrimPath()), first_ns)
        # Prims that are new, or whose kind has changed. Those that are gone are there no more.
        for path in notice.GetResyncedPaths():
            if path.IsAbsoluteRootOrPrimPath() and (prim := self._stage.GetPrimAtPath(path)):
                self._follow_below(prim, first_ns)

    def _body_of(self, path):
        while path and path not in self._bodies:
            path = path.rpartition("/")[0]
        return path or None

    def _stepped(self, _dt):
        """After a physics step."""
        t_ns = round(self._clock.get_simulation_time() * 1e9)
        if self._last_ns is not None and t_ns <= self._last_ns:
            # The timeline was stopped. All bodies that are known now are recorded from the start.
            self._bodies = {path: (number, None) for path, (number, _) in self._bodies.items()}
            for recorder in self._recorders.values():
                recorder.clear()
            self._offset_s = math.inf
        self._last_ns = t_ns
        at_s = self._timeline_s(t_ns * 1e-9)
        cache = UsdGeom.XformCache(Usd.TimeCode(at_s * self._stage.GetTimeCodesPerSecond()))
        bodies = [self._pose(path, cache) for path in self._bodies] or None
        for camera, recorder in self._recorders.items():
            recorder.record(t_ns, self._pose(camera, cache), bodies)

    def _timeline_s(self, t_s):
        """Time of the timeline, by which prims are animated, at a time of physics. Each may begin anywhere. The
        timeline has moved on to the end of the frame when physics steps towards it, so the least that it was ahead
        counts."""
        ahead_s = self._timeline.get_current_time() - t_s
        if not 0 <= ahead_s - self._offset_s <= MOST_AHEAD_S:
            self._offset_s = ahead_s
        return t_s + self._offset_s

    def _pose(self, path, cache):
        """Position, metres, and rotation of a prim: x y z, qx qy qz qw."""
        prim = self._stage.GetPrimAtPath(path)
        world = _rigid(cache.GetLocalToWorldTransform(prim))
        driver = prim
        while driver and not driver.HasAPI(UsdPhysics.RigidBodyAPI):
            driver = driver.GetParent()
        if driver:
            told = self._physics.get_rigidbody_transformation(str(driver.GetPath()))
            if told.get("ret_val"):
                x, y, z, w = map(float, told["rotation"])
                moved = Gf.Matrix4d(
                    Gf.Rotation(Gf.Quatd(w, x, y, z)), Gf.Vec3d(*map(float, told["position"]))
                )
                # What is fixed to the body keeps its place in it, wherever USD believes both to be.
                world = world * _rigid(cache.GetLocalToWorldTransform(driver)).GetInverse() * moved
        place, turn = world.ExtractTranslation() * self._unit_m, world.ExtractRotationQuat()
        return [*place, *turn.GetImaginary(), turn.GetReal()]


def _rigid(matrix):
    """A transform without its scale."""
    return matrix.RemoveScaleShear()
