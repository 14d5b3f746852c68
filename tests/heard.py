"""What users are warned of."""

import warnings
from collections.abc import Callable


def warned(make: Callable[[], object]) -> list[str]:
    """The sentences users are warned by while it runs: not what Python, or a compiler of forms that
    runs for the first time, says of files left open."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        make()
    return [str(one.message) for one in found if issubclass(one.category, UserWarning)]
