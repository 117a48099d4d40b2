"""Command-line subcommands that ship with Knotwork."""
