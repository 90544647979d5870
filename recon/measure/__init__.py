"""Quality of a scene: its held-out views against the truth, against photographs, and as an eye sees them."""
