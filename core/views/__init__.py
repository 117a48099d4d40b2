"""How existing viewers (Foxglove, Lichtblick) see a message: a table from message type to views.

A view is one more channel of a log, derived from the lossless one and never read back. A third party
adds its own next to its message class, with `register_view`.
"""

from knotwork.core.views.table import View, register_view, views

__all__ = ["View", "register_view", "views"]
