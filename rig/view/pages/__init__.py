"""The pages: of a scene, of a session without one, of a training as it goes."""
