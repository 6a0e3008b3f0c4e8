"""From the rows of a measurement to the effects that explain them: contacts, one search, drawn machines."""
