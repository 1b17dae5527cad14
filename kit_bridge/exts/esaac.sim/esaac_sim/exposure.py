"""Renderer settings under which HdrColor is light: linear, not exposed, not smoothed over time.

A sensor's exposure is its own (`exposure_gain`); an auto-exposed or anti-aliased image sends events of its own.
"""

NEUTRAL = {
    "/rtx/post/tonemap/fStop": 1.0,
    "/rtx/post/tonemap/exposureTime": 1.0,
    "/rtx/post/tonemap/filmIso": 0.0,
    "/rtx/post/tonemap/responsivity": 1.0,
    "/rtx/post/histogram/enabled": False,
    "/rtx/post/aa/op": 0,
}


def pin(settings):
    """Sets them, and returns what was there, for `restore`."""
    before = {path: settings.get(path) for path in NEUTRAL}
    for path, value in NEUTRAL.items():
        settings.set(path, value)
    return before


def restore(settings, before):
    for path, value in before.items():
        if value is not None:
            settings.set(path, value)
