"""Which exposures to take: the meter, what a camera can tell apart, the planner. No file is written here."""
