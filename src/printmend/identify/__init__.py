"""What a machine's parts do, one part at a time: a motor's drive, its pulley's outline, the Z screw (physics.md §4).

A learner puts them together to a model of the machine; nothing here knows of learners or models.
"""
