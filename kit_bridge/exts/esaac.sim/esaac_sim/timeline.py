"""Plays the timeline for a while. Replicator calls writers only while it plays."""

import contextlib

import omni.timeline

MOST_UPDATES = 10
"""Updates after which a change of the timeline must have happened. Kit applies it at the next one."""


class TimelineStopped(Exception):
    """Somebody stopped or paused the timeline while it had to play."""


@contextlib.asynccontextmanager
async def playing(app):
    """Plays the timeline within the block. Afterwards it is as it was before: stopped, paused or playing.

    Raises `TimelineStopped` if somebody else stopped or paused it meanwhile; it is left so.
    """
    timeline = omni.timeline.get_timeline_interface()
    if timeline.is_playing():
        yield
        if not timeline.is_playing():
            raise TimelineStopped("the timeline was stopped or paused meanwhile")
        return
    was_stopped, time_s = timeline.is_stopped(), timeline.get_current_time()
    timeline.play()
    await _until(app, timeline.is_playing, "play")
    try:
        yield
        if not timeline.is_playing():
            raise TimelineStopped("the timeline was stopped or paused meanwhile")
    finally:
        if timeline.is_playing():
            if was_stopped:
                timeline.stop()
            else:
                timeline.pause()
                timeline.set_current_time(time_s)
            await _until(app, lambda: not timeline.is_playing(), "stop")
            # Some subscribers hear of it one update later. Nothing may be attached before they do.
            await app.next_update_async()


async def _until(app, holds, what):
    for _ in range(MOST_UPDATES):
        await app.next_update_async()
        if holds():
            return
    raise RuntimeError(f"the timeline did not {what} within {MOST_UPDATES} updates")
