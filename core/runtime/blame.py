"""Whatever a node raises becomes an error that names the node; the cause stays attached."""

from collections.abc import Callable
from typing import Any

from knotwork.core.errors import KnotworkError, NodeError


def blame(node: str, error: Exception) -> KnotworkError:
    """Return the error to show for what `node` raised."""
    if isinstance(error, NodeError):
        return error
    if isinstance(error, KnotworkError):
        blamed = NodeError(node, str(error))
        blamed.exit_code = error.exit_code
        return blamed
    return NodeError(node, f"{type(error).__name__}: {error}", hint="the traceback is in run.log")


def guarded(node: str, call: Callable[[], Any]) -> Any:
    """Call a node; what it raises comes out as a KnotworkError."""
    try:
        return call()
    except Exception as error:
        raise blame(node, error) from error
