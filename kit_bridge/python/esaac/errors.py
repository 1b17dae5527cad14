"""The exceptions of this package. Each is an `EsaacError`, and one of Python's own kinds too. And its warnings."""


class EsaacError(Exception):
    """Every error of this package."""


class SensorError(EsaacError, ValueError):
    """A parameter of a sensor is wrong. `parameter` names it; `expected` and `actual` say what is wrong."""

    def __init__(self, message, parameter=None, expected=None, actual=None):
        super().__init__(message)
        self.parameter = parameter
        self.expected = expected
        self.actual = actual


class FrameError(EsaacError, ValueError):
    """A frame is wrong: an array's type, shape, strides or device, or the frame's time."""


class ArgumentError(EsaacError, ValueError):
    """Another argument is out of range."""


class DeviceError(EsaacError, RuntimeError):
    """No suitable device was found, or the device failed."""


class ClosedError(EsaacError, RuntimeError):
    """Use after `close`."""


class RosError(EsaacError, RuntimeError):
    """ROS 2: there is no network to publish on, or the recording cannot be written."""


class ForkError(EsaacError, RuntimeError):
    """A camera of the parent process was used in a forked child."""


class PoseWarning(UserWarning):
    """Depth and poses do not predict the motion vectors that came with them, or a simulation has poses that are not
    finite."""


class SynthesisWarning(UserWarning):
    """Synthesis `auto` leaves depth, ids or poses out, because something else is missing for exact paths."""


class InputWarning(UserWarning):
    """What moves is not told well enough by the frames that were given, so that many events must be false."""


class LightWarning(UserWarning):
    """The light is beyond that which a preset was fitted for, or a lamp flickers too fast for the sub-steps."""
