"""F10: the IMU of Isaac Sim 6, at rest but for a turn. Its numbers are arrays."""

import warp as wp

from isaacsim.sensors import physics


class IMUSensor:
    def __init__(self, path):
        self._older = physics.IMUSensor(path)

    def get_data(self, read_gravity=True):
        data = self._older.get_data(read_gravity)
        return {
            name: wp.array(v, dtype=wp.float32) if isinstance(v, tuple) else v for name, v in data.items()
        }
