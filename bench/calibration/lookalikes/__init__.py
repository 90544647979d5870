"""Views that stand wrongly because parts of their scene look alike, with and without the checks of poses."""
