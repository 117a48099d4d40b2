"""Keeps Python's garbage collector from stopping a run.

A full collection walks every object there is with the interpreter held: no thread goes on, none that feeds a
motor's watchdog either. After a hundred modules have been imported that is a tenth of a second and more, and a
whole second on a busy machine; what has been made since is little.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def settled(collect: bool = True) -> Iterator[None]:
    """Leave all objects that exist now out of the collections within.

    Parameters
    ----------
    collect
        First free what is garbage among them, which takes as long as one full collection.
    """
    if collect:
        gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
