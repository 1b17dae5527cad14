"""What can go wrong. Every exception of this package is an `EsaacError`, and one of Python's own kinds too."""


class EsaacError(Exception):
    """Every error of this package."""


class SensorError(EsaacError, ValueError):
    """A sensor's parameter is wrong: `parameter` names it, `expected` and `actual` say how."""

    def __init__(self, message, parameter=None, expected=None, actual=None):
        super().__init__(message)
        self.parameter = parameter
        self.expected = expected
        self.actual = actual


class FrameError(EsaacError, ValueError):
    """A frame is wrong: type, shape, strides or device of an array, or its time."""


class ArgumentError(EsaacError, ValueError):
    """Another argument is out of range."""


class DeviceError(EsaacError, RuntimeError):
    """There is no device that will do, or it failed."""


class ClosedError(EsaacError, RuntimeError):
    """Use after `close`."""


class RosError(EsaacError, RuntimeError):
    """ROS 2: there is no network to publish on, or a recording that cannot be written."""


class ForkError(EsaacError, RuntimeError):
    """Use of a parent's camera in a forked process."""
