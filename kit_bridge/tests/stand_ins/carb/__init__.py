"""F9, and a log that tests can read."""

LINES = []


def _log(level):
    return lambda message: LINES.append((level, message))


log_info, log_warn, log_error = _log("info"), _log("warn"), _log("error")
