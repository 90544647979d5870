"""A view as a picture of linear light: its bracket merged, its exposure, its lens taken out of it."""
