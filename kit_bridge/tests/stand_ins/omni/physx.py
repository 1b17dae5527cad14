"""F13: physics that moves bodies along given paths, several steps a frame."""

import numpy as np

STEPS = 4
"""Physics steps a frame."""

bodies = {}
"""Position and rotation (x y z w) of each rigid body, as functions of time in seconds; tests set them."""

time_s = 0.0
_subscribed = []


class _Subscription:
    def __init__(self, call):
        self.call = call
        _subscribed.append(self)

    def unsubscribe(self):
        if self in _subscribed:
            _subscribed.remove(self)


class _Physx:
    def subscribe_physics_on_step_events(self, fn, pre_step, order):
        assert not pre_step and order == 0
        return _Subscription(fn)

    def get_rigidbody_transformation(self, path):
        if path not in bodies:
            return {"ret_val": False}
        position, rotation = bodies[path](time_s)
        return {"ret_val": True, "position": tuple(position), "rotation": tuple(rotation)}


_PHYSX = _Physx()


def get_physx_interface():
    return _PHYSX


def step_to(frame, rate_hz):
    """The physics steps that end at a frame's time."""
    global time_s
    for step in range(1, STEPS + 1) if frame else ():
        time_s = (frame - 1 + step / STEPS) / rate_hz
        for subscription in list(_subscribed):
            subscription.call(1 / rate_hz / STEPS)
    time_s = frame / rate_hz


def place(path):
    """Where the renderer sees a rigid body; None for other prims."""
    return np.array(bodies[path](time_s)[0]) if path in bodies else None


def reset():
    global time_s
    time_s = 0.0
    bodies.clear()
    _subscribed.clear()
