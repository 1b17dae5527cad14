from .test_extension import TestExtension

__all__ = ["TestExtension"]
