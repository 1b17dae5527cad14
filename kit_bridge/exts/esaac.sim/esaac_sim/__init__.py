"""Event cameras in Isaac Sim and Omniverse Kit."""

from .bridge import Bridge
from .extension import Extension
from .schema import CameraSpec, cameras

__all__ = ["Bridge", "CameraSpec", "Extension", "cameras"]
