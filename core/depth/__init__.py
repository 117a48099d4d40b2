"""Incremental depth from a moving camera: observers, certainty, controllers, each as plain kernels.

Thesis chapters 8 and 9. Everything here works on arrays; plugins and experiments call the same functions.
"""
