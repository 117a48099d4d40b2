"""Which curves lie in a box: an R-tree (libspatialindex)."""

from knotwork.core.errors import InputError

Box = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]


class BoxIndex:
    """Boxes by number, found by what they meet.

    Raises
    ------
    InputError
        The package `rtree` is not installed.
    """

    def __init__(self) -> None:
        try:
            from rtree.index import Index
        except ImportError as error:
            raise InputError("the map spline-curve needs the package rtree", hint="pip install rtree") from error
        self._tree = Index()

    def insert(self, key: int, box: Box) -> None:
        """Add a box."""
        self._tree.insert(key, box)

    def remove(self, key: int, box: Box) -> None:
        """Take a box out; `box` is what was inserted."""
        self._tree.delete(key, box)

    def meeting(self, box: Box) -> list[int]:
        """Return the keys of all boxes that meet `box`."""
        return list(self._tree.intersection(box))
