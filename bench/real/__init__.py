"""Real photographs at the sizes people shoot."""
