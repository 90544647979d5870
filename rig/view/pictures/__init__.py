"""Pictures of a scene: drawn in float, its layers, tones, and the spot meter."""
