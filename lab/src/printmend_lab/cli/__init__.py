"""The laboratory's commands: each a few lines over a function."""
