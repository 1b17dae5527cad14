"""F10: the IMU, at rest but for a turn."""

from omni.replicator import core as rep


class IMUSensor:
    def __init__(self, prim_path):
        self.prim_path = prim_path

    def get_data(self, read_gravity=True):
        """The state at the last physics step."""
        return {
            "linear_acceleration": (0.0, 0.0, 9.81 if read_gravity else 0.0),
            "angular_velocity": (0.0, 0.0, 0.25),
            "orientation": (1.0, 0.0, 0.0, 0.0),
            "time": rep._FRAME / rep.RATE_HZ,
            "physics_step": rep._FRAME,
        }
