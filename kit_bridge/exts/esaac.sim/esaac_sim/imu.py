"""An IMU sensor of the stage: a sample for each rendered frame."""

from esaac import ros


class Imu:
    """Reads Isaac Sim's sensor at a path. Its axes are its prim's: x forward, y left, z up for ROS."""

    def __init__(self, path):
        try:
            from isaacsim.sensors.physics import IMUSensor
        except ImportError as error:
            raise ros.RosError(
                f"esaac:imu names {path}, and isaacsim.sensors.physics is not enabled"
            ) from error
        self._sensor, self._last_ns = IMUSensor(prim_path=path), None

    def samples(self):
        """The present sample, once. With gravity, as an IMU feels it."""
        data = self._sensor.get_data(read_gravity=True)
        t_ns = round(float(data["time"]) * 1e9)
        if t_ns == self._last_ns:
            return ()
        self._last_ns = t_ns
        rate, force = (tuple(map(float, data[name])) for name in ("angular_velocity", "linear_acceleration"))
        return (ros.Imu(t_ns, rate, force),)
