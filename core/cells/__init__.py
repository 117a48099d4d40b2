"""Maps made of square cells: ray traversal, interpolation, alignment. Imports nothing by itself."""
