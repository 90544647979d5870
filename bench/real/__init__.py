"""Real photographs at the sizes people shoot: rig beside the trainers that its users have."""
