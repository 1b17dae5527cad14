"""Closes several things. What fails keeps none of the others open, and every error is told."""


class CloseError(Exception):
    """Some things failed to close; `exceptions` holds an error for each."""

    def __init__(self, exceptions):
        super().__init__("; ".join(f"{type(error).__name__}: {error}" for error in exceptions))
        self.exceptions = tuple(exceptions)


class Closing:
    """Calls what it is given and gathers the errors; `finish` raises them together."""

    def __init__(self):
        self._errors = []

    def call(self, function, *arguments):
        """Whether it succeeded."""
        try:
            function(*arguments)
        except CloseError as error:
            self._errors.extend(error.exceptions)
        except Exception as error:  # Others' code. Every kind of error is told in the end.
            self._errors.append(error)
        else:
            return True
        return False

    def finish(self):
        # Errors hold the frames that they passed, and those hold this object: keep no errors here.
        errors, self._errors = self._errors, []
        if errors:
            raise CloseError(errors)
