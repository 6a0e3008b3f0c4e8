"""From the rows of a measurement to the effects that made them: contacts, one search, machines drawn from it."""
