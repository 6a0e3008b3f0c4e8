"""Peers: the methods that machine tools, printers and hysteresis compensation use, as learners beside ours.

Each module is one method, with its source. Every peer learns each motor by itself from a trace (`rows`), shares the
skew of x against y with all others (`branches`), and chooses between its own options by held-out blocks. Those that
come down to two branches of play are mechanisms, which every planner reads; those that remember more are `memory`'s
models, which planners ask move by move. Nothing here is used to mend a print.
"""
