"""Uniform B-splines, sparse and fast: curves, tiled surfaces, fits, merges. Usable alone."""
