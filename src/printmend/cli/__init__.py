"""The commands: a few lines each over a library function. A command's parameters are its options, however many."""
