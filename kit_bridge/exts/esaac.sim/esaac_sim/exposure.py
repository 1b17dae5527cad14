"""Renderer settings under which HdrColor is linear light, without exposure or smoothing over time.

The sensor has its own exposure (`exposure_gain`). Automatic exposure and temporal anti-aliasing would change the
image by themselves, and so make events that no motion has caused.
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
    """Sets them and returns the old values, for `restore`."""
    before = {path: settings.get(path) for path in NEUTRAL}
    for path, value in NEUTRAL.items():
        settings.set(path, value)
    return before


def restore(settings, before):
    for path, value in before.items():
        if value is None:
            # It had none, and Kit's own default goes again.
            settings.destroy_item(path)
        else:
            settings.set(path, value)
