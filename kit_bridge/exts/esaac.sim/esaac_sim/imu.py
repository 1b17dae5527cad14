"""An IMU sensor of the stage: a sample for each rendered frame."""

from esaac import ros
from esaac.poses import on_host


class Imu:
    """Reads Isaac Sim's IMU sensor at a path, in the axes of its prim. ROS wants x forward, y left, z up."""

    def __init__(self, path):
        self._sensor, self._last_ns = _sensor_class(path)(path), None

    def samples(self):
        """The newest sample, if it was not read before. It includes gravity, as a real IMU measures it."""
        data = self._sensor.get_data(read_gravity=True)
        t_ns = round(float(data["time"]) * 1e9)
        if t_ns == self._last_ns:
            return ()
        self._last_ns = t_ns
        rate, force = (
            tuple(map(float, on_host(data[name]).ravel()))
            for name in ("angular_velocity", "linear_acceleration")
        )
        return (ros.Imu(t_ns, rate, force),)


def _sensor_class(path):
    """Of Isaac Sim 6, or of those before it."""
    try:
        from isaacsim.sensors.experimental.physics import IMUSensor
    except ImportError:
        try:
            from isaacsim.sensors.physics import IMUSensor
        except ImportError as error:
            raise ros.RosError(
                f"esaac:imu names {path}, and neither isaacsim.sensors.experimental.physics nor "
                "isaacsim.sensors.physics is enabled"
            ) from error
    return IMUSensor
