"""The scale of light in cd/m2, from readings of meters and known lamps."""
