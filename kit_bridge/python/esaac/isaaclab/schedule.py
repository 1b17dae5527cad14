"""When which environment has a frame, in whole physics steps."""

import numpy as np

from esaac.errors import ArgumentError


class Schedule:
    """Frames of all environments fall on the same physics steps. One that was reset has a frame at once, too.

    Isaac Lab's own clock is a float32 for each environment, which drifts, and begins anew at a reset.
    """

    def __init__(self, count, period_s, physics_s):
        self._physics_s = physics_s
        # As Isaac Lab does: the first step at which the period is over. A thousandth forgives how 1/30 is written.
        self.period_steps = max(1, int(np.ceil(period_s / physics_s - 1e-3)))
        self._period_s = period_s
        self.due = np.ones(count, bool)
        self.restarts = np.ones(count, bool)
        self._last_step = np.full(count, -1, np.int64)
        self._first = np.zeros(count, bool)

    def check(self, dt_s):
        """Fails if sensors are asked so seldom that frames would be lost."""
        steps = max(1, round(dt_s / self._physics_s))
        if self.period_steps % steps:
            raise ArgumentError(
                f"the camera's update_period is {self._period_s:g} s, but sensors are updated every "
                f"{steps} physics steps ({dt_s:g} s), so frames would be lost. If Newton's actuators run all steps "
                "of an environment step at once, set SimulationCfg(use_newton_actuators=False); else set "
                "update_period to a multiple of that time"
            )

    def begun_at(self, step):
        """Those whose last frame was at this physics step, and the first of its episode."""
        return self._first & (self._last_step == step)

    def since(self, step):
        """Those that have had a frame after a physics step."""
        return self._last_step > step

    def reset(self, envs):
        self.due[envs] = self.restarts[envs] = True

    def advance(self, step):
        """Marks who is due at a physics step."""
        self.due |= step // self.period_steps > self._last_step // self.period_steps

    def done(self, step):
        """The due ones have had their frame."""
        self._last_step[self.due] = step
        self._first[self.due] = self.restarts[self.due]
        self.due[:] = self.restarts[:] = False
