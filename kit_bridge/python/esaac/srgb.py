"""Light of colours that are encoded as sRGB."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def linear_of(encoded: Any) -> NDArray[np.float64]:
    """Linear light, 0 to 1, of encoded values, of which those outside 0 to 1 are taken as the nearest."""
    encoded = np.clip(np.asarray(encoded, np.float64), 0, 1)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
