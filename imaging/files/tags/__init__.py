"""Values that a picture file states about itself: its colours, its exposure, its maker."""
