"""Bodies with corruptions and prints, as files: the published data set's layout, and lists of bodies."""
